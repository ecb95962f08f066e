/** Which session is on the screen when an answer comes later than a person's choice, and which are kept behind it. */
import { methods, type ClientContext } from "@agentclientprotocol/sdk";
import { afterEach, beforeEach, describe, expect, it } from "vitest";
import { INITIAL, getState, setState } from "../../state/store";
import { RECENT_SESSIONS, newSession, openSession, receiveUpdate } from "./sessions";
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
