/** Who is connected, as the agent reports it in `_robot/people` to those who may operate the robot. */
import { parseRole, type Role } from "./bridge";
import { asNumber, asRecords, asString, isRecord } from "./fields";

export interface Person {
  name: string;
  role: Role;
  /** How many screens and other clients are open under this name. */
  connections: number;
  /** The sessions that these clients watch, the one opened last first. */
  sessions: string[];
}

/** An entry without a name or a known role is left out. */
export function parsePeople(params: unknown): Person[] {
  return asRecords(isRecord(params) ? params["people"] : null).flatMap(parsePerson);
}

function parsePerson(entry: Record<string, unknown>): Person[] {
  const name = asString(entry["name"]);
  const role = parseRole(entry["role"]);
  if (name === null || role === null) return [];
  const sessions = Array.isArray(entry["sessions"]) ? entry["sessions"] : [];
  return [
    {
      name,
      role,
      connections: Math.max(1, asNumber(entry["connections"]) ?? 1),
      sessions: sessions.filter((id): id is string => typeof id === "string"),
    },
  ];
}
