/** The one large line of a kiosk. */
import type { SessionUpdate } from "@agentclientprotocol/sdk";
import { describe, expect, it } from "vitest";
import { parseTelemetry } from "../../wire/telemetry";
import { EMPTY, type Conversation } from "../../state/conversation/conversation";
import { promptEnded, promptSent, sessionReducer } from "../../state/conversation/reducer";
import { robotActivity, exchange } from "./robot-activity";
import type { LinkState } from "../../wire/link-state";
import { META } from "../../wire/meta";

const ONLINE: LinkState = { status: "online" };
const MOTION = { kind: "navigate", place: "kitchen", distance: 12, seconds: 15 };

const telemetry = (fields: object = {}): ReturnType<typeof parseTelemetry> =>
  parseTelemetry({ robot: "Sancho", online: true, ...fields });

function play(...updates: SessionUpdate[]): Conversation {
  const asked = promptSent(EMPTY, "Take me to the kitchen", "Kiosk");
  return updates.reduce((state, update) => sessionReducer(state, { sessionId: "s", update }), asked);
}

function call(
  tool: string,
  status: "pending" | "in_progress",
  waits?: "permission" | "robot",
): SessionUpdate[] {
  const announced: SessionUpdate = {
    sessionUpdate: "tool_call",
    toolCallId: "c1",
    title: tool === "speak" ? "Say aloud: “Hello.”" : `Title of ${tool}`,
    status,
    ...(tool === "speak" ? { rawInput: { text: "Hello." } } : {}),
    _meta: { [META.tool]: tool },
  };
  if (waits === undefined) return [announced];
  const waiting: SessionUpdate = {
    sessionUpdate: "tool_call_update",
    toolCallId: "c1",
    status: "pending",
    _meta: { [META.waiting]: { for: waits } },
  };
  return [announced, waiting];
}

const said = (conversation: Conversation, fields?: object): ReturnType<typeof robotActivity> =>
  robotActivity(ONLINE, telemetry(fields), null, conversation, "s");

describe("what the robot is doing for a visitor", () => {
  it("is thinking from the wish on", () => expect(said(play()).kind).toBe("thinking"));
  it("is nothing when the turn is over", () => {
    expect(said(promptEnded(play(...call("take_photo", "in_progress")), "end_turn")).kind).toBe("nothing");
  });
  it("waits for a member of staff, and says for what", () => {
    expect(said(play(...call("speak", "pending", "permission")))).toEqual({
      kind: "permission",
      what: "Say aloud: “Hello.”",
      says: "Hello.",
      untranslated: "Hello.",
    });
  });
  it("waits no longer once it has been decided", () => {
    const decided: SessionUpdate = {
      sessionUpdate: "tool_call_update",
      toolCallId: "c1",
      status: "in_progress",
    };
    const conversation = play(...call("speak", "pending", "permission"), decided);
    expect(said(conversation)).toEqual({ kind: "speaking", text: "Hello." });
    expect(said(conversation, { speaking: "Hello there." })).toEqual({
      kind: "speaking",
      text: "Hello there.",
    });
  });
  it("waits for the robot while somebody else has it", () => {
    expect(said(play(...call("navigate_to_place", "pending", "robot"))).kind).toBe("queue");
  });
  it("drives, with the way that is left", () => {
    const conversation = play(...call("navigate_to_place", "in_progress"));
    expect(said(conversation, { motion: MOTION })).toEqual({
      kind: "driving",
      place: "kitchen",
      metres: 12,
      seconds: 15,
    });
    expect(said(conversation)).toEqual({ kind: "driving", place: null, metres: null, seconds: null });
  });
  it("works for somebody else only where that is so", () => {
    const turn = { sessionId: "other", by: "Ana" };
    expect(said(EMPTY, { turn }).kind).toBe("elsewhere");
    expect(said(EMPTY, { turn: { ...turn, sessionId: "s" } }).kind).toBe("nothing");
  });
  it("says nothing old without a connection or a robot", () => {
    const conversation = play(...call("navigate_to_place", "in_progress"));
    expect(robotActivity({ status: "waiting", retryAt: 0 }, null, 7, conversation, "s").kind).toBe("offline");
    expect(said(conversation, { online: false }).kind).toBe("unreachable");
    expect(robotActivity(ONLINE, null, 7, conversation, "s").kind).toBe("unreachable");
    expect(robotActivity({ status: "connecting", first: true }, null, null, EMPTY, null).kind).toBe(
      "nothing",
    );
  });
});

describe("the exchange on the screen", () => {
  it("is the last wish and what came of it", () => {
    const first = promptEnded(play(...call("take_photo", "in_progress")), "end_turn");
    const second = promptSent(first, "Say hello", "Kiosk");
    expect(exchange(first).map(({ kind }) => kind)).toEqual(["user", "tool"]);
    expect(exchange(second).map(({ kind }) => kind)).toEqual(["user"]);
    expect(exchange(EMPTY)).toEqual([]);
  });
});
