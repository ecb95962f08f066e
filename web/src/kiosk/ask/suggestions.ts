/** What a kiosk suggests, of what its robot can do. Pure; the texts are in `i18n`. */
import type { Abilities, Place } from "../../wire/abilities";

export type Suggestion =
  { key: "toThe" | "to"; place: string } | { key: "see" | "sayHello" | "where" | "battery" | "abilities" };

const PLACES = 3;
const FEWEST = 4;
const MOST = 6;

/** Four to six suggestions; fewer for a robot without places and these tools, down to the one that every agent can answer. */
export function suggestions({ places, tools }: Pick<Abilities, "places" | "tools">): Suggestion[] {
  const hasTool = (tool: string): boolean => tools.includes(tool);
  const offered: Suggestion[] = hasTool("navigate_to_place") ? suggestedPlaces(places).map(goTo) : [];
  if (hasTool("take_photo")) offered.push({ key: "see" });
  if (hasTool("speak")) offered.push({ key: "sayHello" });
  if (hasTool("get_current_pose")) offered.push({ key: "where" });
  if (offered.length < FEWEST && hasTool("get_robot_status")) offered.push({ key: "battery" });
  if (offered.length < FEWEST) offered.push({ key: "abilities" });
  return offered.slice(0, MOST);
}

/** Whether the name of a place takes an article, as in "the kitchen": a name with a number, as "lab 2.3.7", does not. */
export const isWord = (name: string): boolean => !/\d/.test(name);

/** Places whose names mean something to a stranger come first; at least one is a numbered room, where there is one. */
function suggestedPlaces(places: Place[]): Place[] {
  const rooms = places.filter(({ type }) => type !== "docking");
  const words = rooms.filter(({ name }) => isWord(name));
  const numbered = rooms.filter(({ name }) => !isWord(name));
  const some = words.slice(0, numbered.length > 0 ? PLACES - 1 : PLACES);
  return [...some, ...numbered.slice(0, PLACES - some.length)];
}

function goTo({ name }: Place): Suggestion {
  return { key: isWord(name) ? "toThe" : "to", place: name };
}
