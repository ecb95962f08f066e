/**
 * What a turn spends its time on, from the times of its events: segments that follow each other without a gap. Pure, so
 * the same events give the same timeline, live or replayed. Between events nobody knows more than these tell; the agent's
 * own measure comes with the end of the turn and is kept beside the segments, never mixed with them.
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
  /** Null for one that was begun here, until the agent tells. */
  turnId: string | null;
  begun: number;
  /** Null while it runs. */
  ended: number | null;
  segments: Segment[];
  /** What the time of each tool call counts as, by its id. */
  calls: Record<string, Phase>;
  /** When a tool call last failed; null before the first that does. */
  failedAt: number | null;
  /** As the agent measured it; null until it has ended, and where nobody measured. */
  measured: Seconds | null;
}

/** Shorter than anybody can see, in s: two events of one moment. */
const MOMENT = 0.001;

export function startTimeline(at: number, turnId: string | null): Timeline {
  const first: Segment = { phase: "thought", from: at, to: null };
  return { turnId, begun: at, ended: null, segments: [first], calls: {}, failedAt: null, measured: null };
}

/** Takes in one event of the session, recorded at `at`. */
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
  if (running(timeline)) return next(timeline, update, at);
  // The one who asked is not sent the prompt: where it waited behind another turn, this is the first sign of its own.
  return begins(update) ? next(startTimeline(at, null), update, at) : timeline;
}

/** The turn is over, told by the answer to the prompt: where the agent announced the end, this changes nothing. */
export function endTimeline(timeline: Timeline | null, at: number): Timeline | null {
  return running(timeline) ? closed(timeline, at) : timeline;
}

function running(timeline: Timeline | null): timeline is Timeline {
  return timeline !== null && timeline.ended === null;
}

function begins(update: SessionUpdate): boolean {
  const kind = update.sessionUpdate;
  return kind === "agent_thought_chunk" || kind === "agent_message_chunk" || kind === "tool_call";
}

function next(timeline: Timeline, update: SessionUpdate, at: number): Timeline {
  switch (update.sessionUpdate) {
    case "agent_thought_chunk":
      return thought(timeline, at);
    case "agent_message_chunk":
    case "plan":
      return withoutThought(timeline);
    case "tool_call": {
      const phase = phaseOf(update._meta) ?? "tools";
      const known = { ...withoutThought(timeline), calls: { ...timeline.calls, [update.toolCallId]: phase } };
      return goOn(known, update.status === "in_progress" ? phase : "protocols", at);
    }
    case "tool_call_update": {
      const waiting = waitingOf(update._meta);
      if (waiting !== null) return goOn(timeline, waiting === "robot" ? "waiting" : "person", at);
      if (update.status === "in_progress") {
        return goOn(timeline, timeline.calls[update.toolCallId] ?? "tools", at);
      }
      if (update.status === "failed") return goOn({ ...timeline, failedAt: at }, "inference", at);
      return update.status === "completed" ? goOn(timeline, "inference", at) : timeline;
    }
    case "session_info_update": {
      const turn = turnOf(update._meta);
      if (turn?.state !== "ended") return timeline;
      return measured(closed(timeline, at, turn.stopReason), phasesOf(update._meta));
    }
    default:
      return timeline;
  }
}

/** The preliminary thought comes in pieces; the inference beside it counts from the last one. */
function thought(timeline: Timeline, at: number): Timeline {
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

/** No thought came before the first step: what was waited for was the model's answer. */
function withoutThought(timeline: Timeline): Timeline {
  const last = timeline.segments.at(-1);
  if (last?.phase !== "thought") return timeline;
  return { ...timeline, segments: [...timeline.segments.slice(0, -1), { ...last, phase: "inference" }] };
}

function goOn(timeline: Timeline, phase: Phase, at: number): Timeline {
  const last = timeline.segments.at(-1);
  if (last === undefined || last.phase === phase) return timeline;
  const before = timeline.segments.slice(0, -1);
  if (at - last.from >= MOMENT) before.push({ ...last, to: at });
  const previous = before.at(-1);
  if (previous?.phase === phase) before[before.length - 1] = { ...previous, to: null };
  else before.push({ phase, from: previous?.to ?? last.from, to: null });
  return { ...timeline, segments: before };
}

function closed(timeline: Timeline, at: number, stopReason?: string): Timeline {
  const last = timeline.segments.at(-1);
  const before = timeline.segments.at(-2);
  if (last === undefined) return { ...timeline, ended: at };
  // After a cancel nothing is inferred any more: what was cut off comes to rest.
  const resting = stopReason === "cancelled" && last.phase === "inference" && last.from === timeline.failedAt;
  const joined = before !== undefined && (resting || at - last.from < MOMENT);
  const segments = joined
    ? [...timeline.segments.slice(0, -2), { ...before, to: at }]
    : [...timeline.segments.slice(0, -1), { ...last, to: at }];
  return { ...timeline, ended: at, segments };
}

/** The measure also tells when a turn that was begun here began: the page only knew when it had asked. */
function measured(timeline: Timeline, seconds: Seconds | null): Timeline {
  if (seconds === null || timeline.ended === null) return { ...timeline, measured: seconds };
  const first = timeline.segments[0];
  const begun = timeline.ended - seconds.total;
  if (timeline.turnId !== null || first === undefined || begun > (first.to ?? timeline.ended)) {
    return { ...timeline, measured: seconds };
  }
  const segments = [{ ...first, from: begun }, ...timeline.segments.slice(1)];
  return { ...timeline, begun, segments, measured: seconds };
}

/** How long each segment is at the time `now`, in s. */
export function lengthsAt(timeline: Timeline, now: number): { phase: Phase; seconds: number }[] {
  return timeline.segments.map(({ phase, from, to }) => ({
    phase,
    seconds: Math.max(0, (to ?? Math.max(now, from)) - from),
  }));
}

/** Seconds by phase at the time `now`, as the events tell them. */
export function secondsAt(timeline: Timeline, now: number): Seconds {
  const seconds = Object.fromEntries([...PHASES, "total"].map((phase) => [phase, 0])) as Seconds;
  for (const { phase, seconds: more } of lengthsAt(timeline, now)) {
    seconds[phase] += more;
    seconds.total += more;
  }
  return seconds;
}
