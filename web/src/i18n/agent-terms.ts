/**
 * The reader's words for what agent and robot call by a known name: tools, modes, settings. Whatever is not known here, or
 * differs from what is known, stays as it came; no free text is ever parsed for its meaning.
 */
import en from "./locales/en";
import i18next from "./index";
import { isRecord } from "../wire/fields";
import { visibleLine } from "../wire/visible-text";

export interface Choice {
  value: string;
  name: string;
  description: string | null;
}

export interface Call {
  /** The tool's own name. A tool of another server has that server's name before its own, and is not known here. */
  tool: string | null;
  input: unknown;
  title: string;
}

type Values = Record<string, string | number>;
type Kind = "string" | "number";

/** The arguments in the title of each known call. */
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

function hasText<Texts extends object>(
  texts: Texts,
  name: string | null,
): name is Extract<keyof Texts, string> {
  return name !== null && Object.hasOwn(texts, name);
}

/** What a call does, in the reader's language. Its arguments are unchanged: whoever decides must be able to compare them. */
export function callText(call: Call): string {
  const known = knownCall(call);
  return known === null ? visibleLine(call.title) : i18next.t(`toolCall.${known.tool}`, known.values);
}

/** The part of `callText` that is not in the page's language: the title as it came, or the sentence to be spoken. */
export function untranslatedPart(call: Call): string {
  const known = knownCall(call);
  if (known === null) return visibleLine(call.title);
  return known.tool === "speak" ? visibleLine(String(known.values["text"])) : "";
}

/** Whether the call is one of the robot server's known ones, whose other sentences are English. */
export function isKnownCall(call: Call): boolean {
  return knownCall(call) !== null;
}

/** The names of the arguments in the translated text; null for a call that keeps its title. */
export function translatedArguments(call: Call): string[] | null {
  const known = knownCall(call);
  return known && Object.keys(known.values);
}

/** The title must match, too: another robot's tool may have the same name and do something else. */
function knownCall({ tool, input, title }: Call): { tool: keyof typeof en.toolCall; values: Values } | null {
  if (!hasText(en.toolCall, tool)) return null;
  const values = valuesOf(ARGUMENTS[tool], input);
  return values !== null && titlesOf(tool, values).includes(visibleLine(title)) ? { tool, values } : null;
}

/** The English title, with every way of writing its numbers. */
function titlesOf(tool: keyof typeof en.toolCall, values: Values): string[] {
  let written: Values[] = [{}];
  for (const [name, value] of Object.entries(values))
    written = written.flatMap((others) => writtenForms(value).map((form) => ({ ...others, [name]: form })));
  return written.map((forms) => i18next.t(`toolCall.${tool}`, { ...forms, lng: "en" }));
}

/** The ways in which a title may write an argument: Python writes 3.0 where JSON has 3. */
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

/** The reader's word for an argument or a field of data. */
export function argumentName(key: string): string {
  return hasText(en.argument, key) ? i18next.t(`argument.${key}`) : visibleLine(key.replaceAll("_", " "));
}

/** What a tool does, without its arguments, in the reader's language. */
export function toolText(tool: string | null, title: string): string {
  return hasText(en.tools, tool) && title === en.tools[tool]
    ? i18next.t(`tools.${tool}`)
    : visibleLine(title);
}

/** The part of `toolText` that is not in the page's language. */
export function untranslatedTitle(tool: string | null, title: string): string {
  return hasText(en.tools, tool) && title === en.tools[tool] ? "" : visibleLine(title);
}

/** Name and description must match, too: another agent's mode may have the same id and mean something else. */
export function translateMode({ value, name, description }: Choice): Choice {
  if (!hasText(en.mode, value) || name !== en.mode[value] || description !== en.modeText[value])
    return { value, name, description };
  return { value, name: i18next.t(`mode.${value}`), description: i18next.t(`modeText.${value}`) };
}

/** The reader's word for a mode of which only the id is known, as in the log. */
export function modeName(id: string): string {
  return hasText(en.mode, id) ? i18next.t(`mode.${id}`) : id;
}

export function settingName(id: string, name: string): string {
  return hasText(en.setting, id) && name === en.setting[id] ? i18next.t(`setting.${id}`) : name;
}
