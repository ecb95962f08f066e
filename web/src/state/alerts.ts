/**
 * Which alerts stand at the top of the screen, in which order: computed from the store, never stored. At most two, unless
 * more are grave. A cut connection hides every alert about the robot, and a hidden alert comes back when it is news again.
 */
import { isCutOff } from "../wire/link-state";
import type { DatabaseFailure } from "../wire/telemetry";
import type { HiddenAlerts, State } from "./store";

export type AlertKind =
  "stop-failed" | "stopped" | "cut" | "silent" | "robot-lost" | "database" | "halted" | "battery";

type AlertInputs = Pick<
  State,
  "hidden" | "stopError" | "stop" | "link" | "reachable" | "silentSince" | "health" | "telemetry"
>;

const MAX_ALERTS = 2;
const LOW_BATTERY = 0.2;
/** A battery alert comes back when the level has fallen so much further. */
const NEWS_STEP = 0.05;

/** The hidden alerts after new telemetry: a battery that has recovered is news when it is low again. */
export function keepHidden(hidden: HiddenAlerts, telemetry: State["telemetry"]): HiddenAlerts {
  const recovered = telemetry?.online === true && !batteryIsLow(telemetry);
  return recovered && hidden.battery !== null ? { ...hidden, battery: null } : hidden;
}

export function alerts(state: AlertInputs): AlertKind[] {
  const { hidden, stopError, stop, link, telemetry } = state;
  const found: AlertKind[] = [];
  if (stopError !== null) found.push("stop-failed");
  if (stop !== null) found.push("stopped");
  if (isCutOff(link)) found.push("cut");
  else if (link.status === "online") found.push(...silenceAlerts(state));
  if (databaseFailure(state) !== null) found.push("database");
  const minor: AlertKind[] = [];
  const halted = telemetry?.halted ?? null;
  // Once the robot is stopped, what ended its motion before matters no more.
  if (halted !== null && stop === null && halted.at !== hidden.halted) minor.push("halted");
  if (batteryIsLow(telemetry) && batteryIsNews(telemetry, hidden.battery)) minor.push("battery");
  return [...found, ...minor.slice(0, Math.max(0, MAX_ALERTS - found.length))];
}

/** The ACP connection is open. Telemetry that comes proves that the network works, even while an HTTP request goes unanswered. */
function silenceAlerts({ silentSince, reachable, telemetry, health }: AlertInputs): AlertKind[] {
  if (!reachable && telemetry?.online !== true) return ["cut"];
  if (health?.robot.up === false || telemetry?.online === false) return ["robot-lost"];
  return silentSince === null ? [] : ["silent"];
}

/** Why conversations cannot be kept; null while they can, and where the agent's last word on it may be old. */
export function databaseFailure({
  link,
  silentSince,
  telemetry,
}: Pick<State, "link" | "silentSince" | "telemetry">): DatabaseFailure | null {
  return link.status === "online" && silentSince === null ? (telemetry?.database ?? null) : null;
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
  return crossed || level <= hiddenAt - NEWS_STEP;
}
