/**
 * The arguments of a call that its title does not tell: whoever decides must see all of it, and nothing twice. In a title
 * that came as it is, a value counts as told when it stands in the title as a word of its own, once for each argument.
 */
import { translatedArguments, writtenForms, type Call } from "../../i18n/agent-terms";
import { isRecord } from "../../wire/fields";

export function remainingArguments(call: Call): Record<string, unknown> {
  if (!isRecord(call.input)) return {};
  const entries = Object.entries(call.input).filter(([, value]) => value !== null && value !== undefined);
  // In words of ours an argument may look told that is not: "a" is a word of a Spanish title.
  const told = new Set(translatedArguments(call) ?? found(call.title, entries));
  return Object.fromEntries(entries.filter(([key]) => !told.has(key)));
}

function found(title: string, entries: [string, unknown][]): string[] {
  const told: string[] = [];
  let rest = title;
  // The longest first: a number may stand in a sentence that is another argument.
  for (const [key, value] of [...entries].sort((a, b) => String(b[1]).length - String(a[1]).length)) {
    const left = without(rest, value);
    if (left === null) continue;
    rest = left;
    told.push(key);
  }
  return told;
}

/** The text less one mention of the value; null when it does not mention it. */
function without(text: string, value: unknown): string | null {
  for (const form of writtenForms(value)) {
    const escaped = form.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");
    const mention = new RegExp(`(?<![\\p{L}\\p{N}.,-])${escaped}(?![\\p{L}\\p{N}]|[.,]\\p{N})`, "u");
    if (mention.test(text)) return text.replace(mention, "\n");
  }
  return null;
}
