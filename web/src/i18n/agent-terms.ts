/**
 * What agent and robot call by a known name, in the reader's language: tools, modes, settings. Whatever is not known
 * here, or is not what it should be, stays as it came; no free text is ever read to guess what it means.
 */
import en from "./locales/en";
import i18next from "./index";
import { isRecord } from "../wire/fields";

export interface Choice {
  value: string;
  name: string;
  description: string | null;
}

export interface Call {
  /** The tool's own name; that of another server than the robot's bears the server's name, and is not known. */
  tool: string | null;
  input: unknown;
  title: string;
}

type Values = Record<string, string | number>;
type Kind = "string" | "number";

/** The arguments that stand in the title of a call. */
const ARGUMENTS: Record<keyof typeof en.toolCall, Record<string, Kind>> = {
  get_topological_map: {},
  get_current_pose: {},
  get_robot_status: {},
  take_photo: {},
  navigate_to_place: { place: "string" },
  navigate_to_pose: { x: "number", y: "number" },
  rotate_in_place: { degrees: "number" },
  speak: { text: "string" },
};

function knows<Texts extends object>(
  texts: Texts,
  name: string | null,
): name is Extract<keyof Texts, string> {
  return name !== null && Object.hasOwn(texts, name);
}

/** What a call does. Its arguments stand in it as they are: who decides must be able to compare. */
export function callText(call: Call): string {
  const known = knownCall(call);
  return known === null ? call.title : i18next.t(`toolCall.${known.tool}`, known.values);
}

/** What in those words is not the page's: the title that came, or what is to be said aloud. */
export function untranslatedPart(call: Call): string {
  const known = knownCall(call);
  if (known === null) return call.title;
  return known.tool === "speak" ? String(known.values["text"]) : "";
}

/** Whether these are words of the robot server that we know, so that what it says of the call is English. */
export function isKnownCall(call: Call): boolean {
  return knownCall(call) !== null;
}

/** The names of the arguments that stand in our words for a call; null where it keeps the title that came. */
export function translatedArguments(call: Call): string[] | null {
  const known = knownCall(call);
  return known && Object.keys(known.values);
}

/** A tool of another robot may have the same name and do something else: its title must be the one that is known. */
function knownCall({ tool, input, title }: Call): { tool: keyof typeof en.toolCall; values: Values } | null {
  if (!knows(en.toolCall, tool)) return null;
  const values = valuesOf(ARGUMENTS[tool], input);
  return values !== null && titlesOf(tool, values).includes(title) ? { tool, values } : null;
}

/** Its title in English, in every form that its numbers may have. */
function titlesOf(tool: keyof typeof en.toolCall, values: Values): string[] {
  let written: Values[] = [{}];
  for (const [name, value] of Object.entries(values))
    written = written.flatMap((others) => writtenForms(value).map((form) => ({ ...others, [name]: form })));
  return written.map((forms) => i18next.t(`toolCall.${tool}`, { ...forms, lng: "en" }));
}

/** How a title writes an argument: Python writes 3.0 where JSON has 3. */
export function writtenForms(value: unknown): string[] {
  if (typeof value === "string") return value === "" ? [] : [value];
  if (typeof value !== "number") return [];
  return Number.isInteger(value) ? [`${value}.0`, String(value)] : [String(value)];
}

function valuesOf(wanted: Record<string, Kind>, input: unknown): Values | null {
  const given = isRecord(input) ? input : {};
  const values: Values = {};
  for (const [name, kind] of Object.entries(wanted)) {
    const value = given[name];
    if (typeof value !== kind || value === "") return null;
    values[name] = value as string | number;
  }
  return values;
}

/** What an argument is called, or another piece of data. */
export function argumentName(key: string): string {
  return knows(en.argument, key) ? i18next.t(`argument.${key}`) : key.replaceAll("_", " ");
}

/** What a tool does, whatever its arguments. */
export function toolText(tool: string | null, title: string): string {
  return knows(en.tools, tool) && title === en.tools[tool] ? i18next.t(`tools.${tool}`) : title;
}

/** What in those words is not the page's. */
export function untranslatedTitle(tool: string | null, title: string): string {
  return knows(en.tools, tool) && title === en.tools[tool] ? "" : title;
}

/** Another agent's mode may have the same name and mean something else: its text must be the one that is known. */
export function translateMode({ value, name, description }: Choice): Choice {
  if (!knows(en.mode, value) || name !== en.mode[value] || description !== en.modeText[value])
    return { value, name, description };
  return { value, name: i18next.t(`mode.${value}`), description: i18next.t(`modeText.${value}`) };
}

/** A mode of which only the name is told, as in the log: there is nothing to compare it with. */
export function modeName(id: string): string {
  return knows(en.mode, id) ? i18next.t(`mode.${id}`) : id;
}

export function settingName(id: string, name: string): string {
  return knows(en.setting, id) && name === en.setting[id] ? i18next.t(`setting.${id}`) : name;
}
