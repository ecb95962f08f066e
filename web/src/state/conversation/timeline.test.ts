/** Where the time of a turn goes, from the times of its events. */
import type { SessionUpdate } from "@agentclientprotocol/sdk";
import { describe, expect, it } from "vitest";
import { PHASES } from "../../wire/phases";
import { startTimeline, lengthsAt, endTimeline, secondsAt, timelineReducer, type Timeline } from "./timeline";
import { META } from "../../wire/meta";

const text = { type: "text" as const, text: "…" };
const turn = (state: string, more: object = {}): object => ({
  [META.turn]: { id: "t1", state, ...more },
});

const prompt: SessionUpdate = {
  sessionUpdate: "user_message_chunk",
  content: text,
  _meta: { ...turn("running") },
};
const thought: SessionUpdate = { sessionUpdate: "agent_thought_chunk", content: text };
const message: SessionUpdate = { sessionUpdate: "agent_message_chunk", content: text };

function call(id: string, status: "pending" | "in_progress", phase: string): SessionUpdate {
  return {
    sessionUpdate: "tool_call",
    toolCallId: id,
    title: id,
    status,
    _meta: { [META.phase]: phase },
  };
}

function goes(id: string, status: "pending" | "in_progress" | "completed" | "failed", waits?: string) {
  const _meta = waits === undefined ? {} : { _meta: { [META.waiting]: { for: waits } } };
  return { sessionUpdate: "tool_call_update", toolCallId: id, status, ..._meta } satisfies SessionUpdate;
}

function end(stopReason = "end_turn", phases?: object): SessionUpdate {
  const measured = phases === undefined ? {} : { [META.phases]: phases };
  return { sessionUpdate: "session_info_update", _meta: { ...turn("ended", { stopReason }), ...measured } };
}

function play(events: [number, SessionUpdate][], from: Timeline | null = null): Timeline {
  const timeline = events.reduce((state, [at, update]) => timelineReducer(state, update, at), from);
  if (timeline === null) throw new Error("no turn began");
  return timeline;
}

const shown = (timeline: Timeline, now = 0): [string, number][] =>
  lengthsAt(timeline, now).map(({ phase, seconds }) => [phase, Math.round(seconds * 1000) / 1000]);

const THE_PAPERS: [number, SessionUpdate][] = [
  [100, prompt],
  [102, thought],
  [102.5, thought],
  [104, call("map", "in_progress", "tools")],
  [104.25, goes("map", "completed")],
  [105, call("drive", "pending", "navigation")],
  [105, goes("drive", "in_progress")],
  [130, goes("drive", "completed")],
  [131, call("speak", "pending", "speech")],
  [131, goes("speak", "pending", "permission")],
  [134, goes("speak", "in_progress")],
  [138, goes("speak", "completed")],
  [138.5, message],
  [139, end()],
];

describe("the paper's prompt", () => {
  it("is told from beginning to end without a gap", () => {
    expect(shown(play(THE_PAPERS))).toEqual([
      ["thought", 2.5],
      ["inference", 1.5],
      ["tools", 0.25],
      ["inference", 0.75],
      ["navigation", 25],
      ["inference", 1],
      ["person", 3],
      ["speech", 4],
      ["inference", 1],
    ]);
  });

  it("adds up to the turn", () => {
    const seconds = secondsAt(play(THE_PAPERS), 0);
    expect(seconds.total).toBeCloseTo(39);
    expect(PHASES.reduce((sum, phase) => sum + seconds[phase], 0)).toBeCloseTo(39);
    expect(seconds).toMatchObject({ navigation: 25, person: 3, speech: 4, inference: 4.25 });
  });

  it("grows while it runs", () => {
    const driving = play(THE_PAPERS.slice(0, 7));
    expect(shown(driving, 106).at(-1)).toEqual(["navigation", 1]);
    expect(shown(driving, 110).at(-1)).toEqual(["navigation", 5]);
    // A clock that is behind makes nothing shorter than nothing.
    expect(shown(driving, 90).at(-1)).toEqual(["navigation", 0]);
  });

  it("stays as it was when it has ended, whatever comes between turns", () => {
    const over = play(THE_PAPERS);
    expect(timelineReducer(over, { sessionUpdate: "current_mode_update", currentModeId: "plan" }, 200)).toBe(
      over,
    );
    expect(shown(over, 500)).toEqual(shown(over));
  });
});

it("a turn that was asked for here begins when it was asked for, and is put right by the measure", () => {
  const measured = { thought: 3, inference: 1, total: 4.5, protocols: 0.5 };
  const asked = play([[100.2, thought]], startTimeline(99, null));
  expect(shown(asked, 101)).toEqual([
    ["thought", 1.2],
    ["inference", 0.8],
  ]);
  const over = play([[102, end("end_turn", measured)]], asked);
  expect(over.begun).toBeCloseTo(97.5);
  expect(shown(over)).toEqual([
    ["thought", 2.7],
    ["inference", 1.8],
  ]);
  expect(over.measured).toMatchObject({ ...measured, speech: 0, person: 0 });
});

it("without a thought all the waiting was for the model's answer", () => {
  const command = play([
    [10, prompt],
    [11, message],
    [12, end()],
  ]);
  expect(shown(command)).toEqual([["inference", 2]]);
});

it("waiting for the robot is no one's thinking", () => {
  const queued = play([
    [0, prompt],
    [1, call("drive", "pending", "navigation")],
    [1, goes("drive", "pending", "robot")],
    [6, goes("drive", "in_progress")],
    [9, goes("drive", "completed")],
    [9, end()],
  ]);
  expect(secondsAt(queued, 9)).toMatchObject({ inference: 1, waiting: 5, navigation: 3, total: 9 });
});

it("after a cancel the robot comes to rest; nothing is inferred any more", () => {
  const cut = play([
    [0, prompt],
    [1, call("drive", "pending", "navigation")],
    [1, goes("drive", "in_progress")],
    [5, goes("drive", "failed")],
    [5.5, end("cancelled")],
  ]);
  expect(shown(cut)).toEqual([
    ["inference", 1],
    ["navigation", 4.5],
  ]);
});

it("a call that is denied, or that no phase is told of, is told all the same", () => {
  const other: SessionUpdate = {
    sessionUpdate: "tool_call",
    toolCallId: "x",
    title: "x",
    status: "in_progress",
  };
  expect(
    shown(
      play([
        [0, prompt],
        [1, call("drive", "pending", "navigation")],
        [1, goes("drive", "failed")],
        [2, other],
        [4, goes("x", "completed")],
        [5, end()],
      ]),
    ),
  ).toEqual([
    ["inference", 2],
    ["tools", 2],
    ["inference", 1],
  ]);
});

it("a new prompt begins anew, further blocks of one do not", () => {
  const first = play([
    [0, prompt],
    [1, prompt],
  ]);
  expect(first.begun).toBe(0);
  const second = { ...prompt, _meta: { [META.turn]: { id: "t2", state: "running" } } } as SessionUpdate;
  expect(play([[7, second]], first)).toMatchObject({ begun: 7, turnId: "t2" });
});

it("a prompt that waited behind another turn begins with its first sign", () => {
  const over = play(THE_PAPERS);
  expect(play([[150, thought]], over)).toMatchObject({ begun: 150, ended: null });
});

it("an agent that announces no end is believed when it answers", () => {
  const over = endTimeline(startTimeline(1, null), 5);
  expect(over).toMatchObject({ ended: 5 });
  expect(endTimeline(over, 9)).toBe(over);
});
