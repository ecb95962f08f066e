/**
 * Reads what robot-acp puts under `_meta` of ACP messages. Whatever comes from the wire is unknown until it has
 * passed through here; a field of the wrong shape counts as absent, never as an error.
 */
import { PHASES, type Phase, type Seconds } from "./phases";

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

/** What a call would do; a length in m and a time in s where the robot tells them. */
export interface Preview {
  pathLength: number | null;
  seconds: number | null;
}

export type Waiting = "permission" | "robot";

export function isRecord(value: unknown): value is Record<string, unknown> {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

export function asString(value: unknown): string | null {
  return typeof value === "string" ? value : null;
}

export function asNumber(value: unknown): number | null {
  return typeof value === "number" && Number.isFinite(value) ? value : null;
}

export function seqOf(meta: Meta): number | null {
  return asNumber(meta?.["robot-acp/seq"]);
}

/** When the event was recorded, in Unix seconds by the agent's clock. */
export function atOf(meta: Meta): number | null {
  return asNumber(meta?.["robot-acp/at"]);
}

export function authorOf(meta: Meta): string | null {
  return asString(meta?.["robot-acp/by"]);
}

/** Who took the robot away from the turn that says so; null when it says anything else. */
export function takenOverBy(meta: Meta): string | null {
  const taken = meta?.["robot-acp/taken_over"];
  return isRecord(taken) ? asString(taken["by"]) : null;
}

export function toolOf(meta: Meta): string | null {
  return asString(meta?.["robot-acp/tool"]);
}

export function turnOf(meta: Meta): TurnMark | null {
  const turn = meta?.["robot-acp/turn"];
  if (!isRecord(turn) || (turn["state"] !== "running" && turn["state"] !== "ended")) return null;
  const stopReason = asString(turn["stopReason"]);
  return { id: asString(turn["id"]), state: turn["state"], ...(stopReason === null ? {} : { stopReason }) };
}

export function progressOf(meta: Meta): Progress | null {
  const progress = meta?.["robot-acp/progress"];
  if (!isRecord(progress)) return null;
  const fraction = asNumber(progress["fraction"]);
  return {
    fraction: fraction === null ? null : Math.min(1, Math.max(0, fraction)),
    message: asString(progress["message"]) ?? "",
  };
}

/** What a call that is pending waits for; null when it waits for nothing that the agent names. */
export function waitingOf(meta: Meta): Waiting | null {
  const waiting = meta?.["robot-acp/waiting"];
  const reason = isRecord(waiting) ? waiting["for"] : null;
  return reason === "permission" || reason === "robot" ? reason : null;
}

/** The way that was computed for a question; null when none was. */
export function previewOf(meta: Meta): Preview | null {
  const preview = meta?.["robot-acp/preview"];
  if (!isRecord(preview)) return null;
  return { pathLength: asNumber(preview["path_length"]), seconds: asNumber(preview["seconds"]) };
}

/** Tool name to whether it is allowed; null when the answer does not say. */
export function rememberedOf(meta: Meta): Record<string, boolean> | null {
  const remembered = meta?.["robot-acp/remembered"];
  if (!isRecord(remembered)) return null;
  return Object.fromEntries(
    Object.entries(remembered).filter((entry): entry is [string, boolean] => typeof entry[1] === "boolean"),
  );
}

/** What the time of a tool call counts as. */
export function phaseOf(meta: Meta): Phase | null {
  return PHASES.find((phase) => phase === meta?.["robot-acp/phase"]) ?? null;
}

/** What a turn took, in s by phase. */
export function phasesOf(meta: Meta): Seconds | null {
  const phases = meta?.["robot-acp/phases"];
  if (!isRecord(phases) || asNumber(phases["total"]) === null) return null;
  const told = [...PHASES, "total"].map((phase) => [phase, Math.max(0, asNumber(phases[phase]) ?? 0)]);
  return Object.fromEntries(told) as Seconds;
}

export function decisionOf(meta: Meta): Decision | null {
  const decision = meta?.["robot-acp/decision"];
  if (!isRecord(decision)) return null;
  return {
    by: asString(decision["by"]),
    option: asString(decision["option"]),
    reason: asString(decision["reason"]) ?? "selected",
  };
}
