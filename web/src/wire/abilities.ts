/** Where the robot can be sent and what its tools are, as the agent tells it in `_robot/abilities`. */
import { setState } from "../state/store";
import { asString, isRecord } from "./meta";
import { theAgent } from "../acp/sessions/sessions";

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

/** Asks for them and keeps what is told. When nobody can tell, what was known stays. */
export async function learnAbilities(): Promise<void> {
  const peer = theAgent();
  if (peer === null) return;
  try {
    setState({ abilities: parseAbilities(await peer.request("_robot/abilities", {})) });
  } catch {
    // The robot is away, or the agent another one that does not know this.
  }
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
