/**
 * Keeps one ACP connection to the agent alive: connects, says hello, and connects again with growing pauses.
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
import { parsePeople, type Person } from "../../wire/people";
import { parseTelemetry, type Telemetry } from "../../wire/telemetry";

const TELEMETRY_RATE = 5;
const HELLO_MS = 10_000;
const ANSWER_MS = 5000;

export type LinkState =
  | { status: "connecting"; first: boolean }
  | { status: "online" }
  | { status: "waiting"; retryAt: number }
  | { status: "off" };

export interface LinkEvents {
  onState: (state: LinkState) => void;
  onUpdate: (notification: SessionNotification) => void;
  onTelemetry: (telemetry: Telemetry) => void;
  /** Without it the agent is not asked who is there. */
  onPeople?: ((people: Person[]) => void) | undefined;
  /** A question; `withdrawn` aborts when the agent takes it back or the connection is lost. */
  onQuestion: (
    request: RequestPermissionRequest,
    withdrawn: AbortSignal,
  ) => Promise<RequestPermissionResponse>;
  /** The agent answers: open the session. The connection counts as good when this has resolved. */
  onOpen: (agent: ClientContext, hello: InitializeResponse) => Promise<void>;
  /** The connection is gone or never came to be; another attempt follows unless somebody calls `end`. */
  onLost: () => void;
}

export class Link {
  /** Set while the connection is open and said hello; null otherwise. */
  agent: ClientContext | null = null;
  private connection: ClientConnection | null = null;
  /** The connection whose agent was asked for an answer and has not given one yet. */
  private probed: ClientConnection | null = null;
  /** Set while `run` is at work; aborting it ends it for good. */
  private running: AbortController | null = null;
  /** Set while it waits for the next attempt; called to try at once. */
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

  /** Connect now, whatever the pause. */
  tryNow(): void {
    this.wake?.();
  }

  /** Give up a connection that seems dead; the next attempt follows. */
  drop(): void {
    this.connection?.close();
  }

  /** Ask whether the agent is there, and give the connection up when nothing comes back, be it a refusal. */
  async probe(): Promise<void> {
    const { connection } = this;
    if (connection === null || this.agent === null || this.probed === connection) return;
    this.probed = connection;
    const late = setTimeout(() => connection.close(new Error("no answer")), ANSWER_MS);
    await connection.agent.request(methods.agent.session.list, {}).catch(() => undefined);
    clearTimeout(late);
    if (this.probed === connection) this.probed = null;
  }

  private async run(ended: AbortSignal): Promise<void> {
    let attempt = 0;
    let first = true;
    while (!ended.aborted) {
      this.events.onState({ status: "connecting", first });
      try {
        const { connection, hello } = await this.open();
        this.events.onState({ status: "online" });
        first = false;
        await this.events.onOpen(connection.agent, hello);
        attempt = 0;
        await connection.closed;
      } catch {
        // Why it failed is asked below, over HTTP: a browser tells nothing about a failed WebSocket.
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

  private async open(): Promise<{ connection: ClientConnection; hello: InitializeResponse }> {
    const app = client({ name: "robot-acp dashboard" })
      .onNotification(methods.client.session.update, ({ params }) => this.events.onUpdate(params))
      .onNotification("_robot/telemetry", parseTelemetry, ({ params }) => this.events.onTelemetry(params))
      .onNotification("_robot/people", parsePeople, ({ params }) => this.events.onPeople?.(params))
      .onRequest(methods.client.session.requestPermission, ({ params, signal }) =>
        this.events.onQuestion(params, signal),
      );
    const connection = app.connect(createWebSocketStream(this.url, { protocols: ["acp.v1"] }));
    this.connection = connection;
    const late = setTimeout(() => connection.close(new Error("no answer to initialize")), HELLO_MS);
    try {
      const hello = await connection.agent.request(methods.agent.initialize, {
        protocolVersion: PROTOCOL_VERSION,
        clientInfo: { name: "robot-acp-web", version: "0.1.0" },
        clientCapabilities: {
          _meta: {
            "robot-acp/telemetry": { rate: TELEMETRY_RATE },
            "robot-acp/people": this.events.onPeople !== undefined,
          },
        },
      });
      this.agent = connection.agent;
      return { connection, hello };
    } finally {
      clearTimeout(late);
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

/** A function, because the compiler believes that a signal seen open stays open. */
function isAborted(signal: AbortSignal): boolean {
  return signal.aborted;
}
