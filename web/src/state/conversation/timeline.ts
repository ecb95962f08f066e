/**
 * What a turn spends its time on, computed from the times of its events: segments that follow each other without a gap.
 * Pure, so the same events give the same timeline, live or replayed. The agent's own measurement comes with the end of the
 * turn and is kept beside the segments, never mixed with them.
 */
import type { SessionUpdate } from "@agentclientprotocol/sdk";
import { phaseOf, phasesOf, turnOf, waitingOf } from "../../wire/meta";
import { PHASES, type Phase, type Seconds } from "../../wire/phases";

/** Unix seconds by the agent's clock; `to` is null while it lasts. */
export interface Segment {
  phase: Phase;
  from: number;
  to: number | null;
}

/** The turn that runs, or the last one that has ended. */
export interface Timeline {
  /** Null for a turn that the person here began: the agent does not send them its id. */
  turnId: string | null;
  begun: number;
  /** Null while it runs. */
  ended: number | null;
  segments: Segment[];
  /** The phase that each tool call counts towards, by the call's id. */
  calls: Record<string, Phase>;
  /** When a tool call last failed; null while none has. */
  failedAt: number | null;
  /** The agent's own measurement; null until the turn has ended, and with an agent that measures nothing. */
  measured: Seconds | null;
}

/** A segment shorter than this, in s, is left out: its two events belong to the same moment. */
const SHORTEST = 0.001;

export function startTimeline(at: number, turnId: string | null): Timeline {
  const first: Segment = { phase: "thought", from: at, to: null };
  return { turnId, begun: at, ended: null, segments: [first], calls: {}, failedAt: null, measured: null };
}

/** Applies one event of the session, recorded at `at` in Unix seconds. */
export function timelineReducer(
  timeline: Timeline | null,
  update: SessionUpdate,
  at: number,
): Timeline | null {
  if (update.sessionUpdate === "user_message_chunk") {
    const turn = turnOf(update._meta);
    if (turn?.state !== "running") return timeline;
    if (running(timeline) && timeline.turnId === turn.id) return timeline;
    return startTimeline(at, turn.id);
  }
  if (running(timeline)) return advance(timeline, update, at);
  // Whoever sent the prompt does not receive it. If it waited behind another turn, this event is the first of its own turn.
  return startsTurn(update) ? advance(startTimeline(at, null), update, at) : timeline;
}

/** Ends the timeline when the answer to the prompt comes. Where the agent announced the end before, nothing changes. */
export function endTimeline(timeline: Timeline | null, at: number): Timeline | null {
  return running(timeline) ? closeTimeline(timeline, at) : timeline;
}

function running(timeline: Timeline | null): timeline is Timeline {
  return timeline !== null && timeline.ended === null;
}

function startsTurn(update: SessionUpdate): boolean {
  const kind = update.sessionUpdate;
  return kind === "agent_thought_chunk" || kind === "agent_message_chunk" || kind === "tool_call";
}

function advance(timeline: Timeline, update: SessionUpdate, at: number): Timeline {
  switch (update.sessionUpdate) {
    case "agent_thought_chunk":
      return endThought(timeline, at);
    case "agent_message_chunk":
    case "plan":
      return withoutThought(timeline);
    case "tool_call": {
      const phase = phaseOf(update._meta) ?? "tools";
      const known = { ...withoutThought(timeline), calls: { ...timeline.calls, [update.toolCallId]: phase } };
      return switchPhase(known, update.status === "in_progress" ? phase : "protocols", at);
    }
    case "tool_call_update": {
      const waiting = waitingOf(update._meta);
      if (waiting !== null) return switchPhase(timeline, waiting === "robot" ? "waiting" : "person", at);
      if (update.status === "in_progress") {
        return switchPhase(timeline, timeline.calls[update.toolCallId] ?? "tools", at);
      }
      if (update.status === "failed") return switchPhase({ ...timeline, failedAt: at }, "inference", at);
      return update.status === "completed" ? switchPhase(timeline, "inference", at) : timeline;
    }
    case "session_info_update": {
      const turn = turnOf(update._meta);
      if (turn?.state !== "ended") return timeline;
      return withMeasurement(closeTimeline(timeline, at, turn.stopReason), phasesOf(update._meta));
    }
    default:
      return timeline;
  }
}

/** The preliminary thought comes in pieces; the inference that follows counts from the last piece. */
function endThought(timeline: Timeline, at: number): Timeline {
  const [first, second, third] = timeline.segments;
  const preliminary = first?.phase === "thought" && third === undefined;
  if (!preliminary || (second !== undefined && second.phase !== "inference")) return timeline;
  return {
    ...timeline,
    segments: [
      { ...first, to: at },
      { phase: "inference", from: at, to: null },
    ],
  };
}

/** The first step came without a thought before it, so the time until then was the model's inference. */
function withoutThought(timeline: Timeline): Timeline {
  const last = timeline.segments.at(-1);
  if (last?.phase !== "thought") return timeline;
  return { ...timeline, segments: [...timeline.segments.slice(0, -1), { ...last, phase: "inference" }] };
}

function switchPhase(timeline: Timeline, phase: Phase, at: number): Timeline {
  const last = timeline.segments.at(-1);
  if (last === undefined || last.phase === phase) return timeline;
  const before = timeline.segments.slice(0, -1);
  if (at - last.from >= SHORTEST) before.push({ ...last, to: at });
  const previous = before.at(-1);
  if (previous?.phase === phase) before[before.length - 1] = { ...previous, to: null };
  else before.push({ phase, from: previous?.to ?? last.from, to: null });
  return { ...timeline, segments: before };
}

function closeTimeline(timeline: Timeline, at: number, stopReason?: string): Timeline {
  const last = timeline.segments.at(-1);
  const before = timeline.segments.at(-2);
  if (last === undefined) return { ...timeline, ended: at };
  // After a cancel the model infers nothing: this time belongs to the call that failed by the cancel.
  const afterCancel =
    stopReason === "cancelled" && last.phase === "inference" && last.from === timeline.failedAt;
  const joined = before !== undefined && (afterCancel || at - last.from < SHORTEST);
  const segments = joined
    ? [...timeline.segments.slice(0, -2), { ...before, to: at }]
    : [...timeline.segments.slice(0, -1), { ...last, to: at }];
  return { ...timeline, ended: at, segments };
}

/** Adds the agent's measurement, which also says when a turn of the person here began: the page knows only when they asked. */
function withMeasurement(timeline: Timeline, seconds: Seconds | null): Timeline {
  if (seconds === null || timeline.ended === null) return { ...timeline, measured: seconds };
  const first = timeline.segments[0];
  const begun = timeline.ended - seconds.total;
  if (timeline.turnId !== null || first === undefined || begun > (first.to ?? timeline.ended)) {
    return { ...timeline, measured: seconds };
  }
  const segments = [{ ...first, from: begun }, ...timeline.segments.slice(1)];
  return { ...timeline, begun, segments, measured: seconds };
}

/** How long each segment is at the time `now`; both in s. */
export function lengthsAt(timeline: Timeline, now: number): { phase: Phase; seconds: number }[] {
  return timeline.segments.map(({ phase, from, to }) => ({
    phase,
    seconds: Math.max(0, (to ?? Math.max(now, from)) - from),
  }));
}

/** Seconds by phase at the time `now`, from the times of the events. */
export function secondsAt(timeline: Timeline, now: number): Seconds {
  const seconds = Object.fromEntries([...PHASES, "total"].map((phase) => [phase, 0])) as Seconds;
  for (const { phase, seconds: more } of lengthsAt(timeline, now)) {
    seconds[phase] += more;
    seconds.total += more;
  }
  return seconds;
}
