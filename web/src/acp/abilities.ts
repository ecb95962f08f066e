/** Where the robot can be sent and what its tools are, as the agent tells it in `_robot/abilities`. */
import type { ClientContext } from "@agentclientprotocol/sdk";
import { asString, isRecord } from "./meta";

export interface Place {
  name: string;
  /** "space", "docking", or what another robot calls it; null when it does not say. */
  type: string | null;
}

export interface Abilities {
  places: Place[];
  /** Names of tools. */
  tools: string[];
  /** What a tool does in words, by its name. */
  titles: Record<string, string>;
}

/** Throws what the request throws; an agent that does not know it refuses. */
export async function askAbilities(peer: ClientContext): Promise<Abilities> {
  return parseAbilities(await peer.request("_robot/abilities", {}));
}

export function parseAbilities(answer: unknown): Abilities {
  const told = isRecord(answer) ? answer : {};
  return {
    places: records(told["places"]).flatMap(({ name, type }) =>
      typeof name === "string" ? [{ name, type: asString(type) }] : [],
    ),
    tools: records(told["tools"]).flatMap(({ name }) => (typeof name === "string" ? [name] : [])),
    titles: Object.fromEntries(
      records(told["tools"]).flatMap(({ name, title }) =>
        typeof name === "string" && typeof title === "string" ? [[name, title]] : [],
      ),
    ),
  };
}

function records(value: unknown): Record<string, unknown>[] {
  return Array.isArray(value) ? value.filter(isRecord) : [];
}
