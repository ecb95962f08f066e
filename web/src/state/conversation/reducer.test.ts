/** The reducer against updates as the agent sends them: the turn of the paper's P1, replays, and what can go wrong. */
import type { SessionNotification, SessionUpdate } from "@agentclientprotocol/sdk";
import { describe, expect, it } from "vitest";
import { EMPTY, type Conversation, type ToolItem } from "./conversation";
import {
  cancelRequested,
  MAX_ITEMS,
  sessionOpened,
  promptEnded,
  promptFailed,
  promptSent,
  sessionReducer,
} from "./reducer";
import { META } from "../../wire/meta";

const SESSION = "s1";

function note(update: SessionUpdate, seq?: number): SessionNotification {
  return {
    sessionId: SESSION,
    update,
    ...(seq === undefined ? {} : { _meta: { [META.seq]: seq } }),
  };
}

function numbered(updates: SessionUpdate[], from = 1): SessionNotification[] {
  return updates.map((update, index) => note(update, from + index));
}

function play(notifications: SessionNotification[], from: Conversation = EMPTY): Conversation {
  return notifications.reduce(sessionReducer, from);
}

const text = (words: string): { type: "text"; text: string } => ({ type: "text", text: words });

const ASKED: SessionUpdate = {
  sessionUpdate: "user_message_chunk",
  content: text("Go to lab 2.3.7 and tell them that the meeting is at noon"),
  _meta: { [META.by]: "Ana", [META.turn]: { id: "t1", state: "running" } },
};

const ENDED: SessionUpdate = {
  sessionUpdate: "session_info_update",
  _meta: { [META.turn]: { id: "t1", state: "ended", stopReason: "end_turn" } },
};

function progress(fraction: number, message: string): SessionUpdate {
  return {
    sessionUpdate: "tool_call_update",
    toolCallId: "c2",
    content: [{ type: "content", content: text(message) }],
    _meta: { [META.progress]: { fraction, message } },
  };
}

const P1: SessionUpdate[] = [
  ASKED,
  { sessionUpdate: "agent_thought_chunk", content: text("I will look the lab up, ") },
  { sessionUpdate: "agent_thought_chunk", content: text("drive there, and ask before I speak.") },
  { sessionUpdate: "session_info_update", title: "Deliver a message" },
  {
    sessionUpdate: "plan",
    entries: [
      { content: "Go to lab 2.3.7", priority: "medium", status: "in_progress" },
      { content: "Say: the meeting is at noon", priority: "medium", status: "pending" },
    ],
  },
  {
    sessionUpdate: "tool_call",
    toolCallId: "c1",
    title: "Read the map",
    kind: "read",
    status: "in_progress",
    rawInput: {},
    _meta: { [META.tool]: "get_topological_map" },
  },
  { sessionUpdate: "tool_call_update", toolCallId: "c1", status: "completed", rawOutput: { nodes: [] } },
  {
    sessionUpdate: "tool_call",
    toolCallId: "c2",
    title: "Drive to lab 2.3.7",
    kind: "execute",
    status: "pending",
    rawInput: { place: "lab 2.3.7" },
    _meta: { [META.tool]: "navigate_to_place" },
  },
  { sessionUpdate: "tool_call_update", toolCallId: "c2", status: "in_progress" },
  progress(0.2, "12.4 m to go, about 15 s"),
  progress(0.6, "6.0 m to go, about 8 s"),
  {
    sessionUpdate: "tool_call_update",
    toolCallId: "c2",
    status: "completed",
    rawOutput: { reached: true, distance: 15.7, duration_s: 28 },
  },
  {
    sessionUpdate: "tool_call",
    toolCallId: "c3",
    title: "Say aloud: “The meeting is at noon.”",
    kind: "execute",
    status: "pending",
    rawInput: { text: "The meeting is at noon." },
  },
  {
    sessionUpdate: "tool_call_update",
    toolCallId: "c3",
    status: "in_progress",
    _meta: { [META.decision]: { by: "Ana", option: "allow_once", reason: "selected" } },
  },
  {
    sessionUpdate: "tool_call_update",
    toolCallId: "c3",
    status: "completed",
    content: [{ type: "content", content: { type: "audio", data: "UklGRg==", mimeType: "audio/wav" } }],
  },
  { sessionUpdate: "agent_message_chunk", content: text("Done. ") },
  { sessionUpdate: "agent_message_chunk", content: text("I told them.") },
  { sessionUpdate: "usage_update", used: 10, size: 100 },
  ENDED,
];

function tool(state: Conversation, id: string): ToolItem {
  const item = state.items.find((known) => known.kind === "tool" && known.id === id);
  if (item?.kind !== "tool") throw new Error(`no tool card ${id}`);
  return item;
}

describe("a whole turn", () => {
  const done = play(numbered(P1));

  it("becomes the items that a person reads, in order", () => {
    expect(done.items.map((item) => item.kind)).toEqual([
      "user",
      "thought",
      "plan",
      "tool",
      "tool",
      "tool",
      "agent",
    ]);
  });

  it("joins the chunks of one message", () => {
    expect(done.items[1]).toMatchObject({
      text: "I will look the lab up, drive there, and ask before I speak.",
    });
    expect(done.items[6]).toMatchObject({ text: "Done. I told them." });
  });

  it("names who asked, and the session", () => {
    expect(done.items[0]).toMatchObject({ author: "Ana", turnId: "t1" });
    expect(done.title).toBe("Deliver a message");
  });

  it("runs from its first event to its last", () => {
    expect(play(numbered(P1.slice(0, 1))).turn).toEqual({ id: "t1", cancelling: false });
    expect(play(numbered(P1.slice(0, -1))).turn).not.toBeNull();
    expect(done.turn).toBeNull();
  });

  it("shows progress while driving, and none of it as the result", () => {
    const driving = tool(play(numbered(P1.slice(0, 11))), "c2");
    expect(driving.progress).toEqual({ fraction: 0.6, message: "6.0 m to go, about 8 s" });
    const arrived = tool(done, "c2");
    expect(arrived).toMatchObject({ status: "completed", progress: null, content: [] });
    expect(arrived.output).toMatchObject({ reached: true });
  });

  it("keeps the decision and the sound on the card of the call", () => {
    expect(tool(done, "c3").decision).toEqual({ by: "Ana", option: "allow_once", reason: "selected" });
    expect(tool(done, "c3").content).toHaveLength(1);
  });
});

describe("answers that are remembered", () => {
  const decision = (option: string, reason = "selected"): SessionUpdate => ({
    sessionUpdate: "tool_call_update",
    toolCallId: "c1",
    status: "in_progress",
    _meta: { [META.decision]: { by: "Ana", option, reason } },
  });
  const call: SessionUpdate = {
    sessionUpdate: "tool_call",
    toolCallId: "c1",
    title: "Say aloud: “Hello.”",
    _meta: { [META.tool]: "speak" },
  };

  it.each([
    ["allow_always", { speak: true }],
    ["reject_always", { speak: false }],
    ["allow_once", {}],
  ])("%s: %j", (option, remembered) => {
    expect(play([note(call), note(decision(option))]).remembered).toEqual(remembered);
  });

  it("are what the agent says when a session is opened: a fork has allowed nothing", () => {
    const before = play([note(call), note(decision("allow_always"))]);
    expect(sessionOpened(before, { _meta: { [META.remembered]: {} } }).remembered).toEqual({});
    expect(sessionOpened(before, {}).remembered).toEqual({ speak: true });
  });
});

describe("replay", () => {
  it("gives the same state as live", () => {
    const updates = numbered(P1);
    const live = updates.reduce<Conversation[]>(
      (states, update) => [...states, sessionReducer(states.at(-1) ?? EMPTY, update)],
      [],
    );
    expect(play(updates)).toEqual(live.at(-1));
    expect(play(updates)).toEqual(play(updates));
  });

  it("changes nothing when an update comes again", () => {
    const updates = numbered(P1);
    const once = play(updates);
    expect(play(updates, once)).toBe(once);
    for (const [index, update] of updates.entries()) {
      const state = play(updates.slice(0, index + 1));
      expect(sessionReducer(state, update)).toBe(state);
    }
  });

  it("takes an update without a number every time", () => {
    const chunk = note({ sessionUpdate: "agent_message_chunk", content: text("a") });
    expect(play([chunk, chunk]).items[0]).toMatchObject({ text: "aa" });
  });

  it("does not touch the state that it was given", () => {
    const before = play(numbered(P1.slice(0, 10)));
    const copy = structuredClone(before);
    play(numbered(P1.slice(10), 11), before);
    expect(before).toEqual(copy);
  });

  it("makes what the sender saw, where the sender's own message was never sent back", () => {
    const sender = play(
      numbered(P1.slice(1), 2),
      promptSent(EMPTY, "Go to lab 2.3.7 and tell them that the meeting is at noon", "Ana"),
    );
    const replayed = play(numbered(P1));
    const shown = (state: Conversation): unknown[] =>
      state.items.map((item) => (item.kind === "user" ? { ...item, turnId: null } : item));
    expect(shown(sender)).toEqual(shown(replayed));
    expect(sender.turn).toEqual(replayed.turn);
  });
});

describe("messages", () => {
  it("are apart when something stands between them", () => {
    const state = play([
      note({ sessionUpdate: "agent_message_chunk", content: text("First.") }),
      note({ sessionUpdate: "tool_call", toolCallId: "c1", title: "Take a photo" }),
      note({ sessionUpdate: "agent_message_chunk", content: text("Second.") }),
    ]);
    expect(state.items.map((item) => item.kind)).toEqual(["agent", "tool", "agent"]);
  });

  it("are apart when their ids differ", () => {
    const state = play([
      note({ sessionUpdate: "agent_message_chunk", content: text("One"), messageId: "m1" }),
      note({ sessionUpdate: "agent_message_chunk", content: text(" and the same"), messageId: "m1" }),
      note({ sessionUpdate: "agent_message_chunk", content: text("Two"), messageId: "m2" }),
    ]);
    expect(state.items).toMatchObject([{ text: "One and the same" }, { text: "Two" }]);
  });

  it("of one prompt with several blocks are one message", () => {
    const meta = { [META.by]: "Ben", [META.turn]: { id: "t9", state: "running" } };
    const state = play([
      note({ sessionUpdate: "user_message_chunk", content: text("Look: "), _meta: meta }),
      note({
        sessionUpdate: "user_message_chunk",
        content: { type: "image", data: "aGk=", mimeType: "image/png" },
        _meta: meta,
      }),
    ]);
    expect(state.items).toHaveLength(1);
    expect(state.items[0]).toMatchObject({ author: "Ben", blocks: [{ type: "text" }, { type: "image" }] });
  });

  it("without any words make no item", () => {
    expect(play([note({ sessionUpdate: "agent_thought_chunk", content: text("") })]).items).toEqual([]);
  });
});

describe("the plan", () => {
  const planOf = (status: "pending" | "completed"): SessionNotification =>
    note({ sessionUpdate: "plan", entries: [{ content: "Go", priority: "medium", status }] });

  it("changes in its place during a turn", () => {
    const state = play([
      note(ASKED),
      planOf("pending"),
      note({ sessionUpdate: "tool_call", toolCallId: "c1", title: "Read the map" }),
      planOf("completed"),
    ]);
    expect(state.items.map((item) => item.kind)).toEqual(["user", "plan", "tool"]);
    expect(state.items[1]).toMatchObject({ entries: [{ status: "completed" }] });
  });

  it("is a new one in the next turn", () => {
    const state = play([note(ASKED), planOf("completed"), note(ENDED), note(ASKED), planOf("pending")]);
    expect(state.items.filter((item) => item.kind === "plan")).toHaveLength(2);
  });
});

describe("tool calls", () => {
  it("of an update for an unknown call appear all the same", () => {
    const state = play([
      note({
        sessionUpdate: "tool_call_update",
        toolCallId: "x",
        title: "Take a photo",
        status: "completed",
      }),
    ]);
    expect(tool(state, "x")).toMatchObject({ title: "Take a photo", status: "completed" });
  });

  it("that are announced twice stay one card", () => {
    const call: SessionUpdate = {
      sessionUpdate: "tool_call",
      toolCallId: "x",
      title: "Turn",
      status: "pending",
    };
    expect(play([note(call), note({ ...call, status: "in_progress" })]).items).toHaveLength(1);
  });

  it("that fail keep the reason", () => {
    const state = play([
      note({ sessionUpdate: "tool_call", toolCallId: "x", title: "Drive" }),
      note({
        sessionUpdate: "tool_call_update",
        toolCallId: "x",
        status: "failed",
        content: [{ type: "content", content: text("occupied: The goal is inside a wall.") }],
      }),
    ]);
    expect(tool(state, "x").content).toHaveLength(1);
    expect(tool(state, "x").status).toBe("failed");
  });
});

describe("the end of a turn", () => {
  it("that was cancelled says so, once", () => {
    const cancelled: SessionUpdate = {
      sessionUpdate: "session_info_update",
      _meta: { [META.turn]: { id: "t1", state: "ended", stopReason: "cancelled" } },
    };
    const asked = cancelRequested(play([note(ASKED, 1)]));
    expect(asked.turn).toEqual({ id: "t1", cancelling: true });
    const ended = promptEnded(sessionReducer(asked, note(cancelled, 2)), "cancelled");
    expect(ended.turn).toBeNull();
    expect(ended.items.filter((item) => item.kind === "note")).toMatchObject([{ stopReason: "cancelled" }]);
  });

  it("is taken from the prompt's answer where the agent announces none", () => {
    expect(promptEnded(promptSent(EMPTY, "hi", "Ana"), "max_tokens")).toMatchObject({
      turn: null,
      items: [{ kind: "user" }, { kind: "note", stopReason: "max_tokens" }],
    });
  });

  it("is also when the prompt was refused", () => {
    expect(promptFailed(promptSent(EMPTY, "hi", "Ana"), "no")).toMatchObject({
      turn: null,
      items: [{ kind: "user" }, { kind: "note", error: "no" }],
    });
  });

  it("cannot be asked for when none runs", () => {
    expect(cancelRequested(EMPTY)).toBe(EMPTY);
  });
});

describe("opening a session", () => {
  const modes = {
    currentModeId: "supervised",
    availableModes: [
      { id: "observe", name: "Observe" },
      { id: "supervised", name: "Supervised" },
    ],
  };
  const modeOption = {
    id: "mode",
    name: "Mode",
    category: "mode",
    type: "select" as const,
    currentValue: "supervised",
    options: [
      { value: "observe", name: "Observe" },
      { value: "supervised", name: "Supervised" },
    ],
  };

  it("tells of a turn that runs, and of one that does not", () => {
    const running = { _meta: { [META.turn]: { id: "t4", state: "running" } } };
    expect(sessionOpened(EMPTY, running).turn).toEqual({ id: "t4", cancelling: false });
    expect(sessionOpened(play([note(ASKED)]), {}).turn).toBeNull();
  });

  it("brings the settings, and later changes keep both ways of publishing them in step", () => {
    const state = sessionOpened(EMPTY, { modes, configOptions: [modeOption] });
    const changed = sessionReducer(
      state,
      note({ sessionUpdate: "current_mode_update", currentModeId: "observe" }),
    );
    expect(changed.modes?.current).toBe("observe");
    expect(changed.options[0]).toMatchObject({ currentValue: "observe" });
    const back = sessionReducer(
      changed,
      note({ sessionUpdate: "config_option_update", configOptions: [modeOption] }),
    );
    expect(back.modes?.current).toBe("supervised");
  });
});

describe("data of the wrong shape under _meta", () => {
  it("count as absent", () => {
    const state = play([
      note({
        sessionUpdate: "tool_call",
        toolCallId: "x",
        title: "Drive",
        _meta: { [META.progress]: "much", [META.decision]: 7, [META.tool]: {} },
      }),
      note({
        sessionUpdate: "session_info_update",
        _meta: { [META.turn]: { id: 1, state: "dancing" } },
      }),
    ]);
    expect(tool(state, "x")).toMatchObject({ progress: null, decision: null, tool: null });
    expect(state.turn).toBeNull();
  });
});

describe("what a tool call waits for", () => {
  const announced: SessionUpdate = {
    sessionUpdate: "tool_call",
    toolCallId: "c9",
    title: "Say aloud: “Hello.”",
    status: "pending",
  };
  const waits = (reason: unknown): SessionUpdate => ({
    sessionUpdate: "tool_call_update",
    toolCallId: "c9",
    status: "pending",
    content: [{ type: "content", content: text("waiting for somebody who may allow it") }],
    _meta: { [META.waiting]: reason },
  });
  function played(...updates: SessionUpdate[]): ToolItem {
    const [item] = play(numbered([announced, ...updates])).items;
    if (item?.kind !== "tool") throw new Error("there is no tool call");
    return item;
  }

  it("is kept while it is pending, and its words are no result", () => {
    const item = played(waits({ for: "robot" }), waits({ for: "permission", timeout_s: 60 }));
    expect(item.waiting).toBe("permission");
    expect(item.content).toEqual([]);
  });

  it("is over with any other status", () => {
    for (const status of ["in_progress", "completed", "failed"] as const) {
      const next: SessionUpdate = { sessionUpdate: "tool_call_update", toolCallId: "c9", status };
      expect(played(waits({ for: "permission" }), next).waiting).toBeNull();
    }
  });

  it("is nothing when it cannot be read", () => {
    for (const wrong of [null, "permission", { for: 7 }, { for: "tea" }]) {
      expect(played(waits(wrong)).waiting).toBeNull();
    }
  });
});

describe("a session that goes on for days", () => {
  const turns = (count: number): SessionUpdate[] =>
    Array.from({ length: count }, (_, index) => [
      { ...ASKED, _meta: { [META.by]: "Ana", [META.turn]: { id: `t${index}`, state: "running" } } },
      { sessionUpdate: "agent_message_chunk", content: text(`answer ${index}`), messageId: `m${index}` },
    ]).flat() as SessionUpdate[];

  it("keeps the newest items, and says how many it does not keep", () => {
    const state = play(numbered(turns(2000)));
    expect(state.items.length).toBeLessThanOrEqual(MAX_ITEMS);
    expect(state.dropped + state.items.length).toBe(4000);
    expect(state.items.at(-1)).toMatchObject({ kind: "agent", text: "answer 1999", key: "i4000" });
    expect(state.items[0]?.key).toBe(`i${state.dropped + 1}`);
  });

  it("drops nothing of a session of an ordinary length", () => {
    const state = play(numbered(turns(MAX_ITEMS / 2)));
    expect([state.items.length, state.dropped]).toEqual([MAX_ITEMS, 0]);
  });
});

describe("a turn from which the robot was taken", () => {
  const TAKEN: SessionUpdate = {
    sessionUpdate: "agent_message_chunk",
    content: text("Sue took the robot over, so I stopped here."),
    _meta: { [META.takenOver]: { by: "Sue" } },
  };
  const CANCELLED: SessionUpdate = {
    sessionUpdate: "session_info_update",
    _meta: { [META.turn]: { id: "t1", state: "ended", stopReason: "cancelled" } },
  };

  it("says who did it, once, and not that it was cancelled", () => {
    const after = play(numbered([ASKED, TAKEN, CANCELLED]));
    expect(after.turn).toBeNull();
    expect(after.items.slice(1)).toEqual([
      { kind: "note", key: "i2", stopReason: null, takenBy: "Sue", error: null },
    ]);
    expect(promptEnded(after, "cancelled")).toBe(after);
  });

  it("says it in the agent's words where nobody is named", () => {
    const lost = play(numbered([ASKED, { ...TAKEN, _meta: {} }, CANCELLED]));
    expect(lost.items.map(({ kind }) => kind)).toEqual(["user", "agent", "note"]);
  });
});
