/**
 * Who is connected, as the agent tells those who may operate the robot, and taking the robot over. Parsed once here;
 * whoever cannot be read is left out.
 */
import { RequestError } from "@agentclientprotocol/sdk";
import { ROLES, type Role } from "../api/http";
import i18next from "../i18n";
import { robotName, getState, toast } from "../state/store";
import { asNumber, asString, isRecord } from "./meta";
import { theAgent } from "../acp/sessions/sessions";

export interface Person {
  name: string;
  role: Role;
  /** How many screens and other clients are open under this name. */
  connections: number;
  /** The sessions that these watch, the one opened last first. */
  sessions: string[];
}

export function parsePeople(params: unknown): Person[] {
  const people = isRecord(params) ? params["people"] : null;
  return Array.isArray(people) ? people.flatMap(parsePerson) : [];
}

function parsePerson(value: unknown): Person[] {
  if (!isRecord(value)) return [];
  const name = asString(value["name"]);
  const role = ROLES.find((known) => known === value["role"]);
  if (name === null || role === undefined) return [];
  const sessions = Array.isArray(value["sessions"]) ? value["sessions"] : [];
  return [
    {
      name,
      role,
      connections: Math.max(1, asNumber(value["connections"]) ?? 1),
      sessions: sessions.filter((id): id is string => typeof id === "string"),
    },
  ];
}

/** Ends the turn of `from` if it still controls the robot; `next`, if it waits for the robot, has it then. */
export async function takeOver(next: string | null, from: string): Promise<void> {
  try {
    const session = next === null ? {} : { sessionId: next };
    const answer = await theAgent()?.request("_robot/take_over", { ...session, from });
    if (isRecord(answer) && answer["from"] === null) {
      toast("info", i18next.t("people.hadNobody", { robot: robotName(getState()) }));
    }
  } catch (error) {
    if (!(error instanceof RequestError)) return;
    const holder = isRecord(error.data) ? asString(error.data["holder"]) : null;
    if (holder === null) toast("danger", error.message, "en");
    else toast("info", i18next.t("people.changedHands", { robot: robotName(getState()), name: holder }));
  }
}
