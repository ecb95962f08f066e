/** What the bridge answers over plain HTTP: who is logged in, and whether the agent and the robot server are up. */
import { asNumber, asString, isRecord } from "./fields";

export const ROLES = ["viewer", "visitor", "operator", "supervisor"] as const;
export type Role = (typeof ROLES)[number];

/** Who is logged in. */
export interface Me {
  name: string;
  role: Role;
  /** The robot's name; empty where the bridge does not say it. */
  robot: string;
}

/** The health of one process behind the bridge. */
export interface Part {
  up: boolean;
  detail: string;
}

export interface Health {
  agent: Part;
  robot: Part;
  robotName: string | null;
}

export function parseRole(value: unknown): Role | null {
  return ROLES.find((role) => role === value) ?? null;
}

/** Null where the answer names no known role: such an answer logs nobody in. */
export function parseMe(body: unknown): Me | null {
  const role = isRecord(body) ? parseRole(body["role"]) : null;
  if (!isRecord(body) || role === null) return null;
  return { name: asString(body["name"]) ?? "", role, robot: asString(body["robot"]) ?? "" };
}

export function parseHealth(body: unknown): Health | null {
  if (!isRecord(body)) return null;
  return {
    agent: parsePart(body["agent"]),
    robot: parsePart(body["robot"]),
    robotName: asString(body["robot_name"]),
  };
}

function parsePart(value: unknown): Part {
  if (!isRecord(value)) return { up: false, detail: "" };
  return {
    up: value["up"] === true,
    detail: asString(value["detail"]) ?? String(asNumber(value["detail"]) ?? ""),
  };
}
