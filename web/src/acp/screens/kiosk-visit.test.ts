/** One visit after another at a kiosk: what is begun late, and that nothing is left of an earlier one. */
import { methods, type ClientContext } from "@agentclientprotocol/sdk";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { INITIAL, getState, setState } from "../../state/store";
import { receiveUpdate } from "../sessions/sessions";
import { sendRequest, endVisit } from "./kiosk-visit";
import { setAgent } from "../connection/agent";

const HELLO = "Salude";

interface Call {
  method: string;
  params: Record<string, unknown>;
  answer: (result: unknown) => void;
}

let calls: Call[];

const asked = (method: string): Call[] => calls.filter((call) => call.method === method);
const prompts = (): unknown[] => asked(methods.agent.session.prompt).map(({ params }) => params["prompt"]);

function connect(): void {
  const request = (method: string, params: Record<string, unknown>): Promise<unknown> =>
    new Promise((answer) => calls.push({ method, params, answer }));
  setAgent({ request } as unknown as ClientContext);
}

/** A wish whose session the agent has begun and whose turn runs. */
async function wished(): Promise<void> {
  void sendRequest(HELLO, "Kiosk");
  asked(methods.agent.session.new)[0]?.answer({ sessionId: "s1" });
  await vi.waitFor(() => expect(prompts()).toHaveLength(1));
}

beforeEach(() => {
  calls = [];
  setState(INITIAL);
  connect();
});

afterEach(() => {
  endVisit();
  setAgent(null);
});

it("begins a session with the first wish", async () => {
  expect(calls).toEqual([]);
  await wished();
  expect(prompts()).toEqual([[{ type: "text", text: "Salude" }]]);
  const shown = getState().conversations["s1"]?.items[0];
  expect(shown?.kind === "user" && shown.blocks).toEqual([{ type: "text", text: "Salude" }]);
});

it("closes the session at the end and keeps nothing, whatever comes late", async () => {
  await wished();
  endVisit();
  expect(asked(methods.agent.session.close)[0]?.params).toEqual({ sessionId: "s1" });
  const late = { type: "text" as const, text: "I said it." };
  receiveUpdate({ sessionId: "s1", update: { sessionUpdate: "agent_message_chunk", content: late } });
  asked(methods.agent.session.prompt)[0]?.answer({ stopReason: "cancelled" });
  await Promise.resolve();
  expect(getState()).toMatchObject({ currentId: null, conversations: {}, drafts: {} });
  expect(getState().attached.size).toBe(0);
});

it("closes a session that came when the visitor had gone, and asks nothing in it", async () => {
  const over = sendRequest(HELLO, "Kiosk");
  endVisit();
  asked(methods.agent.session.new)[0]?.answer({ sessionId: "late" });
  await over;
  expect(asked(methods.agent.session.close)[0]?.params).toEqual({ sessionId: "late" });
  expect(prompts()).toEqual([]);
  expect(getState().conversations).toEqual({});
});

it("asks for nothing twice while it begins", () => {
  void sendRequest(HELLO, "Kiosk");
  void sendRequest(HELLO, "Kiosk");
  expect(asked(methods.agent.session.new)).toHaveLength(1);
});
