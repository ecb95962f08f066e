/** The connection as the page lives with it: made, lost, made again. Real SDK on both ends, the socket in memory. */
import { agent, methods, PROTOCOL_VERSION, type AnyMessage } from "@agentclientprotocol/sdk";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { Link, type LinkEvents } from "./link";
import type { LinkState } from "../../wire/link-state";

class FakeSocket extends EventTarget {
  static all: FakeSocket[] = [];
  static refuse = false;
  /** A line that is dead without having been closed: what is sent goes nowhere. */
  static dead = false;
  readyState = 0;
  private toAgent!: ReadableStreamDefaultController<AnyMessage>;

  constructor(
    readonly url: string,
    readonly protocols: string[],
  ) {
    super();
    FakeSocket.all.push(this);
    if (FakeSocket.refuse) {
      queueMicrotask(() => this.dispatchEvent(new Event("error")));
      return;
    }
    const readable = new ReadableStream<AnyMessage>({
      start: (controller) => {
        this.toAgent = controller;
      },
    });
    const writable = new WritableStream<AnyMessage>({
      write: (message) => {
        this.dispatchEvent(new MessageEvent("message", { data: JSON.stringify(message) }));
      },
    });
    agent({ name: "test" })
      .onRequest(methods.agent.initialize, () => ({
        protocolVersion: PROTOCOL_VERSION,
        agentCapabilities: {},
      }))
      .connect({ readable, writable });
    queueMicrotask(() => {
      this.readyState = 1;
      this.dispatchEvent(new Event("open"));
    });
  }

  send(text: string): void {
    if (!FakeSocket.dead) this.toAgent.enqueue(JSON.parse(text) as AnyMessage);
  }

  close(): void {
    this.readyState = 3;
    this.dispatchEvent(new Event("close"));
  }
}

const states: LinkState["status"][] = [];
let link: Link;

function events(): LinkEvents {
  return {
    onState: (state) => states.push(state.status),
    onUpdate: vi.fn(),
    onTelemetry: vi.fn(),
    onQuestion: () => Promise.resolve({ outcome: { outcome: "cancelled" } }),
    onOpen: vi.fn(() => Promise.resolve()),
    onLost: vi.fn(),
  };
}

beforeEach(() => {
  vi.stubGlobal("WebSocket", FakeSocket);
  FakeSocket.all = [];
  FakeSocket.refuse = false;
  FakeSocket.dead = false;
  states.length = 0;
});

afterEach(() => {
  link.end();
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

it("says hello with the right subprotocol and is online", async () => {
  const on = events();
  link = new Link("ws://robot/acp", on);
  link.start();
  await vi.waitFor(() => expect(on.onOpen).toHaveBeenCalledOnce());
  expect(FakeSocket.all[0]?.protocols).toEqual(["acp.v1"]);
  expect(states).toEqual(["connecting", "online"]);
  expect(link.agent).not.toBeNull();
});

it("waits, then connects again when the socket is lost", async () => {
  const on = events();
  link = new Link("ws://robot/acp", on);
  link.start();
  await vi.waitFor(() => expect(on.onOpen).toHaveBeenCalledOnce());
  FakeSocket.all[0]?.close();
  await vi.waitFor(() => expect(states).toContain("waiting"));
  expect(on.onLost).toHaveBeenCalledOnce();
  expect(link.agent).toBeNull();
  link.tryNow();
  await vi.waitFor(() => expect(on.onOpen).toHaveBeenCalledTimes(2));
  expect(states).toEqual(["connecting", "online", "waiting", "connecting", "online"]);
});

it("goes on trying while nothing answers, and stops when it is ended", async () => {
  FakeSocket.refuse = true;
  const on = events();
  link = new Link("ws://robot/acp", on);
  link.start();
  await vi.waitFor(() => expect(on.onLost).toHaveBeenCalledOnce());
  link.tryNow();
  await vi.waitFor(() => expect(on.onLost).toHaveBeenCalledTimes(2));
  link.end();
  await vi.waitFor(() => expect(states.at(-1)).toBe("off"));
  expect(FakeSocket.all).toHaveLength(2);
});

it("gives up a line that brings no answer, and keeps one that does, be it a refusal", async () => {
  const on = events();
  link = new Link("ws://robot/acp", on);
  link.start();
  await vi.waitFor(() => expect(on.onOpen).toHaveBeenCalledOnce());
  vi.useFakeTimers();
  await link.probe();
  await vi.advanceTimersByTimeAsync(20_000);
  expect(states.at(-1)).toBe("online");
  FakeSocket.dead = true;
  void link.probe();
  await vi.advanceTimersByTimeAsync(4900);
  expect(states.at(-1)).toBe("online");
  await vi.advanceTimersByTimeAsync(200);
  expect(on.onLost).toHaveBeenCalledOnce();
});
