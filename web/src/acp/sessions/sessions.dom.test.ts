/** Which session is on the screen when an answer comes later than a person's choice, and which are kept behind it. */
import { methods, RequestError, type ClientContext } from "@agentclientprotocol/sdk";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { INITIAL, getState, setState } from "../../state/store";
import {
  RECENT_SESSIONS,
  deleteSession,
  newSession,
  openSession,
  prompt,
  receiveUpdate,
  watchSession,
} from "./sessions";
import { setAgent } from "../connection/agent";
import { META } from "../../wire/meta";
import { METHODS } from "../../wire/methods";

let answers: Record<string, (result: unknown) => void>;

beforeEach(() => {
  answers = {};
  setState(INITIAL);
  const request = (method: string): Promise<unknown> => new Promise((answer) => (answers[method] = answer));
  setAgent({ request } as unknown as ClientContext);
});

afterEach(() => setAgent(null));

it("shows a new session once there is one", async () => {
  const asked = newSession();
  answers[methods.agent.session.new]?.({ sessionId: "new" });
  await asked;
  expect(getState().currentId).toBe("new");
});

it("does not take away the session that somebody has chosen meanwhile", async () => {
  const asked = newSession();
  void openSession("chosen");
  answers[methods.agent.session.new]?.({ sessionId: "new" });
  await asked;
  expect(getState().currentId).toBe("chosen");
  expect(getState().attached.has("new")).toBe(true);
});

describe("of the sessions that were on the screen", () => {
  const names = (count: number): string[] => Array.from({ length: count }, (_, number) => `s${number}`);
  const asked: { method: string; params: unknown }[] = [];

  beforeEach(() => {
    asked.length = 0;
    const request = (method: string, params: unknown): Promise<unknown> => {
      asked.push({ method, params });
      return Promise.resolve({});
    };
    setAgent({ request } as unknown as ClientContext);
  });

  it("lets go of those that were left longest ago, here and at the agent", async () => {
    for (const name of names(RECENT_SESSIONS + 3)) await openSession(name);
    const kept = names(RECENT_SESSIONS + 3).slice(-RECENT_SESSIONS);
    expect([...getState().attached]).toEqual(kept);
    expect(Object.keys(getState().conversations)).toEqual(kept);
    const left = asked.filter(({ method }) => method === METHODS.leave).map(({ params }) => params);
    expect(left).toEqual(names(3).map((sessionId) => ({ sessionId })));
  });

  it("counts a session that somebody has come back to as new", async () => {
    for (const name of names(RECENT_SESSIONS)) await openSession(name);
    await openSession("s0");
    await openSession("another");
    expect(getState().attached.has("s0")).toBe(true);
    expect(getState().attached.has("s1")).toBe(false);
  });

  it("keeps one as long as a turn runs in it", async () => {
    await openSession("s0");
    const running = { [META.turn]: { id: "t", state: "running" } };
    receiveUpdate({ sessionId: "s0", update: { sessionUpdate: "session_info_update", _meta: running } });
    for (const name of names(RECENT_SESSIONS + 3).slice(1)) await openSession(name);
    expect(getState().attached.has("s0")).toBe(true);
    const over = { [META.turn]: { id: "t", state: "ended", stopReason: "end_turn" } };
    receiveUpdate({ sessionId: "s0", update: { sessionUpdate: "session_info_update", _meta: over } });
    await openSession("another");
    expect(getState().attached.has("s0")).toBe(false);
  });

  it("keeps one with a turn that was running when the connection was lost", async () => {
    await openSession("s0");
    const running = { [META.turn]: { id: "t", state: "running" } };
    receiveUpdate({ sessionId: "s0", update: { sessionUpdate: "session_info_update", _meta: running } });
    for (const name of names(RECENT_SESSIONS).slice(1)) await openSession(name);
    setAgent(null);
    await openSession("another");
    expect(getState().conversations).toHaveProperty("s0.turn.id", "t");
  });
});

describe("with an agent that answers late", () => {
  interface Call {
    method: string;
    params: Record<string, unknown>;
    answer: (result: unknown) => void;
    fail: (error: Error) => void;
  }

  let calls: Call[];
  const asked = (method: string): Call[] => calls.filter((call) => call.method === method);
  const { session } = methods.agent;
  const texts = (): unknown[] =>
    getState().conversations["s1"]?.items.flatMap((item) => (item.kind === "user" ? item.blocks : [])) ?? [];

  function connect(): void {
    calls = [];
    const request = (method: string, params: Record<string, unknown>): Promise<unknown> =>
      new Promise((answer, fail) => calls.push({ method, params, answer, fail }));
    setAgent({ request } as unknown as ClientContext);
  }

  /** The connection is cut: what was asked fails, and another connection follows. */
  async function cut(): Promise<void> {
    const open = calls;
    setAgent(null);
    for (const { fail } of open) fail(new Error("closed"));
    await Promise.resolve();
    connect();
  }

  async function opened(): Promise<void> {
    const done = openSession("s1");
    asked(session.load)[0]?.answer({});
    await done;
    told(1, { sessionUpdate: "agent_message_chunk", content: { type: "text", text: "Hello." } });
  }

  function told(seq: number, update: object): void {
    receiveUpdate({ sessionId: "s1", update, _meta: { [META.seq]: seq, [META.at]: seq } } as never);
  }

  const ownWords = {
    sessionUpdate: "user_message_chunk",
    content: { type: "text", text: "go" },
    _meta: { [META.by]: "Ana" },
  };

  beforeEach(() => {
    window.history.replaceState(null, "", "/");
    setState({ canResume: true });
    connect();
  });

  it("begins one session, however often New is pressed meanwhile", async () => {
    const both = Promise.all([newSession(), newSession()]);
    expect(asked(session.new)).toHaveLength(1);
    asked(session.new)[0]?.answer({ sessionId: "new" });
    await both;
    expect(getState().currentId).toBe("new");
  });

  it("does not open a session again that was deleted on the screen", async () => {
    await opened();
    setState({
      sessions: [
        { sessionId: "s1", cwd: "/" },
        { sessionId: "s2", cwd: "/" },
      ],
    });
    const done = deleteSession("s1");
    asked(session.delete)[0]?.answer({});
    await Promise.resolve();
    await Promise.resolve();
    asked(session.load)[1]?.answer({});
    await done;
    expect(asked(session.load).map(({ params }) => params["sessionId"])).toEqual(["s1", "s2"]);
    expect(getState()).toMatchObject({ currentId: "s2", toasts: [] });
    expect(window.location.hash).toBe("#/s/s2");
  });

  it("says that a session could not be opened, also one that was already being loaded", async () => {
    void watchSession("s1");
    const done = openSession("s1");
    expect(asked(session.load)).toHaveLength(1);
    expect(getState().opening).toBe(true);
    asked(session.load)[0]?.fail(new RequestError(-32603, "The log cannot be read."));
    await done;
    expect(getState()).toMatchObject({
      opening: false,
      notOpened: "The log cannot be read.",
      currentId: "s1",
    });
    const again = openSession("s1");
    asked(session.load)[1]?.answer({});
    await again;
    expect(getState()).toMatchObject({ opening: false, notOpened: null });
  });

  it("says that a prompt was not sent when there is no connection", async () => {
    await opened();
    setAgent(null);
    expect(await prompt("go", "Ana")).toBe(false);
    expect(getState().toasts.map(({ text }) => text)).toEqual([
      "That was not sent: the connection was lost. Send it again.",
    ]);
    expect(texts()).toEqual([]);
  });

  it("resumes after the last event, and keeps what was there", async () => {
    await opened();
    await cut();
    const done = openSession("s1");
    expect(asked(session.load)).toEqual([]);
    expect(asked(session.resume)[0]?.params).toMatchObject({ sessionId: "s1", _meta: { [META.after]: 1 } });
    told(2, { sessionUpdate: "agent_message_chunk", content: { type: "text", text: " How are you?" } });
    asked(session.resume)[0]?.answer({});
    await done;
    const items = getState().conversations["s1"]?.items ?? [];
    expect(items.map((item) => item.kind === "agent" && item.text)).toEqual(["Hello. How are you?"]);
  });

  it("loads all where the agent cannot resume after an event", async () => {
    setState({ canResume: false });
    await opened();
    await cut();
    void openSession("s1");
    expect(asked(session.resume)).toEqual([]);
    expect(asked(session.load)).toHaveLength(1);
  });

  it("gives a prompt back that was lost with the connection", async () => {
    await opened();
    const arrived = prompt("go", "Ana");
    expect(texts()).toHaveLength(1);
    await cut();
    const done = openSession("s1");
    asked(session.resume)[0]?.answer({});
    await done;
    await vi.waitFor(() => expect(asked(session.list)).toHaveLength(1));
    asked(session.list)[0]?.answer({ sessions: [] });
    expect(await arrived).toBe(false);
    expect(texts()).toEqual([]);
    expect(getState().conversations["s1"]?.turn).toBeNull();
  });

  it("shows a prompt once that the agent had got before the cut", async () => {
    await opened();
    const arrived = prompt("go", "Ana");
    await cut();
    const done = openSession("s1");
    told(2, ownWords);
    asked(session.resume)[0]?.answer({});
    await done;
    await vi.waitFor(() => expect(asked(session.list)).toHaveLength(1));
    asked(session.list)[0]?.answer({ sessions: [] });
    expect(await arrived).toBe(true);
    expect(texts()).toHaveLength(1);
  });

  it("knows by the gap in the numbers that the agent has a prompt, and does not ask for it again", async () => {
    await opened();
    const arrived = prompt("go", "Ana");
    told(3, { sessionUpdate: "agent_thought_chunk", content: { type: "text", text: "I go." } });
    await cut();
    const done = openSession("s1");
    expect(asked(session.resume)[0]?.params).toMatchObject({ _meta: { [META.after]: 3 } });
    asked(session.resume)[0]?.answer({});
    await done;
    await vi.waitFor(() => expect(asked(session.list)).toHaveLength(1));
    asked(session.list)[0]?.answer({ sessions: [] });
    expect(await arrived).toBe(true);
    expect(texts()).toHaveLength(1);
  });
});
