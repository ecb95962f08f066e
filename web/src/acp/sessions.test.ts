/** Which session is on the screen when an answer comes later than a person's choice. */
import { methods, type ClientContext } from "@agentclientprotocol/sdk";
import { afterEach, beforeEach, expect, it } from "vitest";
import { INITIAL, getState, setState } from "../state/store";
import { newSession, openSession, setAgent } from "./sessions";

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
