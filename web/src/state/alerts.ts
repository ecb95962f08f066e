/**
 * What has to be said at the top of the screen, and in which order: computed from all that is known, never stored.
 * Two at most, unless more are grave. What is cut off tells nothing of the robot, and what is hidden comes back when it is news again.
 */
import type { State } from "./store";

export type AlertKind = "stop-failed" | "stopped" | "cut" | "silent" | "robot-lost" | "halted" | "battery";

/** What the person here has read and hidden. */
export interface Hidden {
  /** `at` of the halt; null when none was hidden. */
  halted: number | null;
  /** The level at which it was hidden; null when it was not. */
  battery: number | null;
}

type Known = Pick<
  State,
  "hidden" | "stopError" | "stop" | "link" | "reachable" | "heardUntil" | "health" | "telemetry"
>;

const MOST = 2;
const LOW_BATTERY = 0.2;
/** A battery that has lost so much more is news. */
const FURTHER = 0.05;

/** What stays hidden with what is known now: a battery that has recovered is news when it is low again. */
export function stillHidden(hidden: Hidden, telemetry: State["telemetry"]): Hidden {
  const recovered = telemetry?.online === true && !batteryIsLow(telemetry);
  return recovered && hidden.battery !== null ? { ...hidden, battery: null } : hidden;
}

export function alerts(state: Known): AlertKind[] {
  const { hidden, stopError, stop, link, telemetry } = state;
  const found: AlertKind[] = [];
  if (stopError !== null) found.push("stop-failed");
  if (stop !== null) found.push("stopped");
  if (link.status === "waiting" || (link.status === "connecting" && !link.first)) found.push("cut");
  else if (link.status === "online") found.push(...lost(state));
  const minor: AlertKind[] = [];
  const halted = telemetry?.halted ?? null;
  // A stop matters more than what ended the motion before it.
  if (halted !== null && stop === null && halted.at !== hidden.halted) minor.push("halted");
  if (batteryIsLow(telemetry) && batteryIsNews(telemetry, hidden.battery)) minor.push("battery");
  return [...found, ...minor.slice(0, Math.max(0, MOST - found.length))];
}

/** The line looks open. Telemetry that comes proves that it is, whatever a slow answer to another request seems to say. */
function lost({ heardUntil, reachable, telemetry, health }: Known): AlertKind[] {
  if (!reachable && telemetry?.online !== true) return ["cut"];
  if (health?.robot.up === false || telemetry?.online === false) return ["robot-lost"];
  return heardUntil === null ? [] : ["silent"];
}

type Charge = Pick<NonNullable<State["telemetry"]>, "battery" | "batteryFloor" | "charging"> | null;

export function batteryIsLow(charge: Charge): boolean {
  const level = charge?.battery ?? null;
  if (level === null || charge?.charging === true) return false;
  return level <= Math.max(LOW_BATTERY, charge?.batteryFloor ?? 0);
}

export function isBelowFloor(charge: Charge): boolean {
  return (charge?.battery ?? 1) < (charge?.batteryFloor ?? 0);
}

function batteryIsNews(charge: Charge, hiddenAt: number | null): boolean {
  const level = charge?.battery ?? 1;
  if (hiddenAt === null) return true;
  const crossed = isBelowFloor(charge) && hiddenAt >= (charge?.batteryFloor ?? 0);
  return crossed || level <= hiddenAt - FURTHER;
}
