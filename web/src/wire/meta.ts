/**
 * What robot-acp puts under `_meta` of ACP messages: the keys, each written here and nowhere else, and a reader for each.
 * A field of the wrong shape counts as absent, never as an error.
 */
import { asNumber, asString, isRecord } from "./fields";
import { PHASES, type Phase, type Seconds } from "./phases";

/** Explained in docs/extensions.md. */
export const META = {
  after: "robot-acp/after",
  asker: "robot-acp/asker",
  at: "robot-acp/at",
  by: "robot-acp/by",
  decision: "robot-acp/decision",
  expires: "robot-acp/expires",
  owner: "robot-acp/owner",
  people: "robot-acp/people",
  phase: "robot-acp/phase",
  phases: "robot-acp/phases",
  preview: "robot-acp/preview",
  progress: "robot-acp/progress",
  remembered: "robot-acp/remembered",
  search: "robot-acp/search",
  seq: "robot-acp/seq",
  subject: "robot-acp/subject",
  takenOver: "robot-acp/taken_over",
  telemetry: "robot-acp/telemetry",
  timeoutS: "robot-acp/timeout_s",
  tool: "robot-acp/tool",
  turn: "robot-acp/turn",
  waiting: "robot-acp/waiting",
} as const;

export type Meta = Record<string, unknown> | null | undefined;

export interface TurnMark {
  id: string | null;
  state: "running" | "ended";
  stopReason?: string;
}

export interface Progress {
  /** From 0 to 1; null when nobody knows how long it takes. */
  fraction: number | null;
  message: string;
}

export interface Decision {
  by: string | null;
  option: string | null;
  reason: string;
}

/** What a call would do; a length in m and a time in s where the robot computed them. */
export interface Preview {
  pathLength: number | null;
  seconds: number | null;
}

export type Waiting = "permission" | "robot";

/** The limits of a permission request, beside what ACP itself says of it. */
export interface RequestMark {
  /** Who asked for what the call does. */
  asker: string | null;
  /** What an answer for the whole session would count for, in words. */
  subject: string | null;
  /** When the request ends, in ms by the agent's clock. */
  expires: number | null;
  /** How long the request is open to answers in all, in s. */
  timeoutS: number | null;
}

/** The number of an event within its session. */
export function seqOf(meta: Meta): number | null {
  return asNumber(meta?.[META.seq]);
}

/** When the event was recorded, in Unix seconds by the agent's clock. */
export function atOf(meta: Meta): number | null {
  return asNumber(meta?.[META.at]);
}

export function authorOf(meta: Meta): string | null {
  return asString(meta?.[META.by]);
}

/** Whose session it is; null when the agent does not say. */
export function ownerOf(meta: Meta): string | null {
  return asString(meta?.[META.owner]);
}

/** Who took control of the robot from the turn whose message this is; null when the message reports nothing of the kind. */
export function takenOverBy(meta: Meta): string | null {
  const takenOver = meta?.[META.takenOver];
  return isRecord(takenOver) ? asString(takenOver["by"]) : null;
}

export function toolOf(meta: Meta): string | null {
  return asString(meta?.[META.tool]);
}

export function turnOf(meta: Meta): TurnMark | null {
  const turn = meta?.[META.turn];
  if (!isRecord(turn) || (turn["state"] !== "running" && turn["state"] !== "ended")) return null;
  const stopReason = asString(turn["stopReason"]);
  return { id: asString(turn["id"]), state: turn["state"], ...(stopReason === null ? {} : { stopReason }) };
}

export function progressOf(meta: Meta): Progress | null {
  const progress = meta?.[META.progress];
  if (!isRecord(progress)) return null;
  const fraction = asNumber(progress["fraction"]);
  return {
    fraction: fraction === null ? null : Math.min(1, Math.max(0, fraction)),
    message: asString(progress["message"]) ?? "",
  };
}

/** What a pending call waits for; null when it waits for nothing that the agent names. */
export function waitingOf(meta: Meta): Waiting | null {
  const waiting = meta?.[META.waiting];
  const reason = isRecord(waiting) ? waiting["for"] : null;
  return reason === "permission" || reason === "robot" ? reason : null;
}

export function requestMarkOf(meta: Meta): RequestMark {
  const expires = Date.parse(asString(meta?.[META.expires]) ?? "");
  return {
    asker: asString(meta?.[META.asker]),
    subject: asString(meta?.[META.subject]),
    expires: Number.isNaN(expires) ? null : expires,
    timeoutS: asNumber(meta?.[META.timeoutS]),
  };
}

/** The path that was computed for a permission request; null when none was. */
export function previewOf(meta: Meta): Preview | null {
  const preview = meta?.[META.preview];
  if (!isRecord(preview)) return null;
  return { pathLength: asNumber(preview["path_length"]), seconds: asNumber(preview["seconds"]) };
}

/** Whether each tool with a remembered answer is allowed, by the tool's name; null when the message does not say. */
export function rememberedOf(meta: Meta): Record<string, boolean> | null {
  const remembered = meta?.[META.remembered];
  if (!isRecord(remembered)) return null;
  return Object.fromEntries(
    Object.entries(remembered).filter((entry): entry is [string, boolean] => typeof entry[1] === "boolean"),
  );
}

/** The phase that the time of a tool call counts towards. */
export function phaseOf(meta: Meta): Phase | null {
  return PHASES.find((phase) => phase === meta?.[META.phase]) ?? null;
}

/** What a turn took, in s by phase. */
export function phasesOf(meta: Meta): Seconds | null {
  const phases = meta?.[META.phases];
  if (!isRecord(phases) || asNumber(phases["total"]) === null) return null;
  const seconds = [...PHASES, "total"].map((phase) => [phase, Math.max(0, asNumber(phases[phase]) ?? 0)]);
  return Object.fromEntries(seconds) as Seconds;
}

export function decisionOf(meta: Meta): Decision | null {
  const decision = meta?.[META.decision];
  if (!isRecord(decision)) return null;
  return {
    by: asString(decision["by"]),
    option: asString(decision["option"]),
    reason: asString(decision["reason"]) ?? "selected",
  };
}
