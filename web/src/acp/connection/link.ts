/**
 * Keeps one ACP connection to the agent alive: connects, initializes, and connects again with growing pauses.
 * All protocol work is the official SDK's. What the messages mean is not decided here.
 */
import {
  client,
  methods,
  PROTOCOL_VERSION,
  type ClientConnection,
  type ClientContext,
  type InitializeResponse,
  type RequestPermissionRequest,
  type RequestPermissionResponse,
  type SessionNotification,
} from "@agentclientprotocol/sdk";
import { createWebSocketStream } from "@agentclientprotocol/sdk/experimental/ws-client";
import { backoff } from "../../wire/backoff";
import type { LinkState } from "../../wire/link-state";
import { META } from "../../wire/meta";
import { METHODS } from "../../wire/methods";
import { parsePeople, type Person } from "../../wire/people";
import { parseTelemetry, type Telemetry } from "../../wire/telemetry";

/** Telemetry messages a second. */
const TELEMETRY_RATE = 5;
const INITIALIZE_TIMEOUT_MS = 10_000;
const PROBE_TIMEOUT_MS = 5000;

export interface LinkEvents {
  onState: (state: LinkState) => void;
  onUpdate: (notification: SessionNotification) => void;
  onTelemetry: (telemetry: Telemetry) => void;
  /** Without it the agent is not asked who is connected. */
  onPeople?: ((people: Person[]) => void) | undefined;
  /** A permission request; `withdrawn` aborts when the agent takes it back or the connection is lost. */
  onQuestion: (
    request: RequestPermissionRequest,
    withdrawn: AbortSignal,
  ) => Promise<RequestPermissionResponse>;
  /** The agent answers: open the session. The connection counts as good when this has resolved. */
  onOpen: (agent: ClientContext, initialized: InitializeResponse) => Promise<void>;
  /** The connection is gone or never came to be; another attempt follows unless somebody calls `end`. */
  onLost: () => void;
}

export class Link {
  /** Set while the connection is open and initialized; null otherwise. */
  agent: ClientContext | null = null;
  private connection: ClientConnection | null = null;
  /** The connection that is being probed; null while none is. */
  private probed: ClientConnection | null = null;
  /** Set while `run` works; aborting it ends the link for good. */
  private running: AbortController | null = null;
  /** Set while the next attempt is being waited for; called to try at once. */
  private wake: (() => void) | null = null;

  constructor(
    private readonly url: string,
    readonly events: LinkEvents,
  ) {}

  start(): void {
    if (this.running !== null) return;
    this.running = new AbortController();
    void this.run(this.running.signal);
  }

  end(): void {
    this.running?.abort();
    this.running = null;
    this.wake?.();
    this.connection?.close();
  }

  /** Connects now instead of waiting for the end of the pause. */
  tryNow(): void {
    this.wake?.();
  }

  /** Gives up a connection that seems dead; the next attempt follows. */
  drop(): void {
    this.connection?.close();
  }

  /** Sends a request that every agent answers, and gives the connection up when no answer comes. A refusal is an answer. */
  async probe(): Promise<void> {
    const { connection } = this;
    if (connection === null || this.agent === null || this.probed === connection) return;
    this.probed = connection;
    const timeout = setTimeout(() => connection.close(new Error("no answer")), PROBE_TIMEOUT_MS);
    await connection.agent.request(methods.agent.session.list, {}).catch(() => undefined);
    clearTimeout(timeout);
    if (this.probed === connection) this.probed = null;
  }

  private async run(ended: AbortSignal): Promise<void> {
    let attempt = 0;
    let first = true;
    while (!ended.aborted) {
      this.events.onState({ status: "connecting", first });
      try {
        const { connection, initialized } = await this.open();
        this.events.onState({ status: "online" });
        first = false;
        await this.events.onOpen(connection.agent, initialized);
        attempt = 0;
        await connection.closed;
      } catch {
        // A browser says nothing about why a WebSocket failed; `onLost` asks over HTTP.
      }
      this.connection?.close();
      this.connection = null;
      this.agent = null;
      if (isAborted(ended)) break;
      const pause = backoff(attempt++, Math.random());
      this.events.onState({ status: "waiting", retryAt: Date.now() + pause });
      this.events.onLost();
      await this.pause(pause);
    }
    this.events.onState({ status: "off" });
    this.running = null;
  }

  private async open(): Promise<{ connection: ClientConnection; initialized: InitializeResponse }> {
    const app = client({ name: "robot-acp dashboard" })
      .onNotification(methods.client.session.update, ({ params }) => this.events.onUpdate(params))
      .onNotification(METHODS.telemetry, parseTelemetry, ({ params }) => this.events.onTelemetry(params))
      .onNotification(METHODS.people, parsePeople, ({ params }) => this.events.onPeople?.(params))
      .onRequest(methods.client.session.requestPermission, ({ params, signal }) =>
        this.events.onQuestion(params, signal),
      );
    const connection = app.connect(createWebSocketStream(this.url, { protocols: ["acp.v1"] }));
    this.connection = connection;
    const timeout = setTimeout(
      () => connection.close(new Error("no answer to initialize")),
      INITIALIZE_TIMEOUT_MS,
    );
    try {
      const initialized = await connection.agent.request(methods.agent.initialize, {
        protocolVersion: PROTOCOL_VERSION,
        clientInfo: { name: "robot-acp-web", version: "0.1.0" },
        clientCapabilities: {
          _meta: {
            [META.telemetry]: { rate: TELEMETRY_RATE },
            [META.people]: this.events.onPeople !== undefined,
          },
        },
      });
      this.agent = connection.agent;
      return { connection, initialized };
    } finally {
      clearTimeout(timeout);
    }
  }

  private pause(ms: number): Promise<void> {
    return new Promise((resolve) => {
      const timer = setTimeout(done, ms);
      const wake = (): void => done();
      this.wake = wake;
      function done(): void {
        clearTimeout(timer);
        resolve();
      }
    });
  }
}

/** A function, because the compiler takes `aborted` for unchanged once it has been read as false. */
function isAborted(signal: AbortSignal): boolean {
  return signal.aborted;
}
