/**
 * The robot's state as the agent sends it in `_robot/telemetry`, five times a second. A message that cannot be read
 * counts as "robot not reachable", so that a screen never shows a number that nobody sent.
 */
import type { InitializeResponse } from "@agentclientprotocol/sdk";
import { asNumber, asRecords, asString, isRecord } from "./fields";
import { METHODS } from "./methods";

export interface Pose {
  /** m in the map frame. */
  x: number;
  y: number;
  /** rad, counter-clockwise from the map's x axis. */
  yaw: number;
}

export interface Motion {
  kind: string;
  goal: Pose | null;
  place: string | null;
  /** What is left of the way, in m, and of the time, in s; null where the robot does not say. */
  distance: number | null;
  seconds: number | null;
}

export interface Stop {
  by: string;
  /** Unix seconds. */
  at: number;
}

/** The robot ended a motion by itself, for safety. */
export interface Halt {
  code: string;
  text: string;
  /** Unix seconds. */
  at: number;
}

/** A session whose turn controls the robot or waits for it, and the person who asked. */
export interface Claim {
  sessionId: string;
  by: string;
}

/** The agent cannot use its database of sessions. */
export interface DatabaseFailure {
  /** The agent's own sentence, in English. */
  text: string;
  /** Since when, in Unix seconds. */
  at: number;
}

export interface Telemetry {
  robot: string | null;
  online: boolean;
  pose: Pose | null;
  /** m/s forward, rad/s counter-clockwise. */
  linear: number | null;
  angular: number | null;
  /** From 0 to 1. */
  battery: number | null;
  charging: boolean;
  /** The level below which the robot drives to a dock only; null where nobody says. */
  batteryFloor: number | null;
  motion: Motion | null;
  stop: Stop | null;
  speaking: string | null;
  halted: Halt | null;
  /** The turn that controls the robot, and those that wait for it, the next one first. Null while nobody controls it. */
  turn: (Claim & { waiting?: Claim[] }) | null;
  /** Null while the database of sessions can be used. The agent says it also while the robot is not reachable. */
  database: DatabaseFailure | null;
}

const UNREACHABLE: Telemetry = {
  robot: null,
  online: false,
  pose: null,
  linear: null,
  angular: null,
  battery: null,
  charging: false,
  batteryFloor: null,
  motion: null,
  stop: null,
  speaking: null,
  halted: null,
  turn: null,
  database: null,
};

function parsePose(value: unknown): Pose | null {
  if (!isRecord(value)) return null;
  const [x, y, yaw] = [asNumber(value["x"]), asNumber(value["y"]), asNumber(value["yaw"])];
  return x === null || y === null || yaw === null ? null : { x, y, yaw };
}

function parseMotion(value: unknown): Motion | null {
  if (!isRecord(value)) return null;
  return {
    kind: asString(value["kind"]) ?? "navigate",
    goal: parsePose(value["goal"]),
    place: asString(value["place"]),
    distance: asNumber(value["distance"]),
    seconds: asNumber(value["seconds"]),
  };
}

function parseStop(value: unknown): Stop | null {
  if (!isRecord(value)) return null;
  const at = value["at"];
  const seconds = typeof at === "string" ? Date.parse(at) / 1000 : asNumber(at);
  return {
    by: asString(value["by"]) ?? "",
    at: seconds === null || Number.isNaN(seconds) ? Date.now() / 1000 : seconds,
  };
}

/** The stop in the answer to Stop; null where the answer does not say that the robot is stopped, by whom and when. */
export function parseStopAnswer(body: unknown): Stop | null {
  const stopped = isRecord(body) ? body["stopped"] : null;
  if (!isRecord(stopped)) return null;
  const [by, at] = [asString(stopped["by"]), asNumber(stopped["at"])];
  return by === null || at === null ? null : { by, at };
}

function parseHalt(value: unknown): Halt | null {
  if (!isRecord(value)) return null;
  const at = asNumber(value["at"]);
  return at === null
    ? null
    : { code: asString(value["code"]) ?? "", text: asString(value["text"]) ?? "", at };
}

export function parseTelemetry(params: unknown): Telemetry {
  if (!isRecord(params) || params["online"] !== true) {
    if (!isRecord(params)) return UNREACHABLE;
    return {
      ...UNREACHABLE,
      robot: asString(params["robot"]),
      turn: parseTurn(params["turn"]),
      database: parseDatabase(params["database"]),
    };
  }
  const twist = isRecord(params["twist"]) ? params["twist"] : {};
  const battery = isRecord(params["battery"]) ? params["battery"] : {};
  return {
    robot: asString(params["robot"]),
    online: true,
    pose: parsePose(params["pose"]),
    linear: asNumber(twist["linear"]),
    angular: asNumber(twist["angular"]),
    battery: asNumber(battery["level"]),
    charging: battery["charging"] === true,
    batteryFloor: asNumber(battery["floor"]),
    motion: parseMotion(params["motion"]),
    stop: parseStop(params["stop"]),
    speaking: asString(params["speaking"]),
    halted: parseHalt(params["halted"]),
    turn: parseTurn(params["turn"]),
    database: parseDatabase(params["database"]),
  };
}

function parseDatabase(value: unknown): DatabaseFailure | null {
  if (!isRecord(value)) return null;
  return { text: asString(value["text"]) ?? "", at: asNumber(value["at"]) ?? Date.now() / 1000 };
}

function parseTurn(value: unknown): Telemetry["turn"] {
  const claim = parseClaim(value);
  const waiting = asRecords(isRecord(value) ? value["waiting"] : null);
  return claim && { ...claim, waiting: waiting.flatMap((entry) => parseClaim(entry) ?? []) };
}

function parseClaim(value: unknown): Claim | null {
  if (!isRecord(value)) return null;
  const sessionId = asString(value["sessionId"]);
  return sessionId === null ? null : { sessionId, by: asString(value["by"]) ?? "" };
}

/** Whether the agent says that it sends telemetry. */
export function announcesTelemetry({ agentCapabilities }: InitializeResponse): boolean {
  const about = agentCapabilities?._meta?.["robot-acp"];
  const extensions = isRecord(about) ? about["extensions"] : null;
  return Array.isArray(extensions) && extensions.includes(METHODS.telemetry);
}

/** Whether the agent resumes a session after a numbered event. Plain ACP resumes without what came meanwhile. */
export function resumesAfterEvent({ agentCapabilities }: InitializeResponse): boolean {
  return (
    agentCapabilities?.sessionCapabilities?.resume != null && isRecord(agentCapabilities._meta?.["robot-acp"])
  );
}
