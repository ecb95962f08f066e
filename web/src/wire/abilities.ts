/** The places that the robot can drive to and the tools that it has, as the agent answers `_robot/abilities`. */
import { asRecords, asString, isRecord } from "./fields";

export interface Place {
  name: string;
  /** "space", "docking", or another robot's own word; null when the robot does not say. */
  type: string | null;
}

export interface Abilities {
  places: Place[];
  /** Names of tools. */
  tools: string[];
  /** A title for people, by the name of the tool. */
  titles: Record<string, string>;
}

/** Entries without a name are left out. */
export function parseAbilities(answer: unknown): Abilities {
  const abilities = isRecord(answer) ? answer : {};
  const tools = asRecords(abilities["tools"]);
  return {
    places: asRecords(abilities["places"]).flatMap(({ name, type }) =>
      typeof name === "string" ? [{ name, type: asString(type) }] : [],
    ),
    tools: tools.flatMap(({ name }) => (typeof name === "string" ? [name] : [])),
    titles: Object.fromEntries(
      tools.flatMap(({ name, title }) =>
        typeof name === "string" && typeof title === "string" ? [[name, title]] : [],
      ),
    ),
  };
}
