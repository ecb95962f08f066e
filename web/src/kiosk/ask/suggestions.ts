/** What a kiosk suggests, of what this robot can really do. Pure; the words are in `i18n`. */
import type { Abilities, Place } from "../../wire/abilities";

export type Suggestion =
  { key: "toThe" | "to"; place: string } | { key: "see" | "sayHello" | "where" | "battery" | "abilities" };

const PLACES = 3;
const FEWEST = 4;
const MOST = 6;

/** Four to six, and for a robot that has neither places nor such tools at least what everyone can be asked. */
export function suggestions({ places, tools }: Pick<Abilities, "places" | "tools">): Suggestion[] {
  const can = (tool: string): boolean => tools.includes(tool);
  const offered: Suggestion[] = can("navigate_to_place") ? inviting(places).map(goTo) : [];
  if (can("take_photo")) offered.push({ key: "see" });
  if (can("speak")) offered.push({ key: "sayHello" });
  if (can("get_current_pose")) offered.push({ key: "where" });
  if (offered.length < FEWEST && can("get_robot_status")) offered.push({ key: "battery" });
  if (offered.length < FEWEST) offered.push({ key: "abilities" });
  return offered.slice(0, MOST);
}

/** Whether a name takes an article: one with a number is a proper one. */
export const isWord = (name: string): boolean => !/\d/.test(name);

/** Names that mean something to a stranger come first, but one that is just a number goes with them where there is one. */
function inviting(places: Place[]): Place[] {
  const rooms = places.filter(({ type }) => type !== "docking");
  const words = rooms.filter(({ name }) => isWord(name));
  const numbered = rooms.filter(({ name }) => !isWord(name));
  const some = words.slice(0, numbered.length > 0 ? PLACES - 1 : PLACES);
  return [...some, ...numbered.slice(0, PLACES - some.length)];
}

function goTo({ name }: Place): Suggestion {
  return { key: isWord(name) ? "toThe" : "to", place: name };
}
