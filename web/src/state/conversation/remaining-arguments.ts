/**
 * The arguments of a call that its title does not contain: whoever decides on the call must see all of it, and nothing
 * twice. In a title that came as it is, a value counts as contained when it stands there as a word of its own; each
 * mention counts for one argument.
 */
import { translatedArguments, writtenForms, type Call } from "../../i18n/agent-terms";
import { isRecord } from "../../wire/fields";

export function remainingArguments(call: Call): Record<string, unknown> {
  if (!isRecord(call.input)) return {};
  const entries = Object.entries(call.input).filter(([, value]) => value !== null && value !== undefined);
  // A translated title is not searched: the value "a" would be found in any Spanish sentence.
  const inTitle = new Set(translatedArguments(call) ?? argumentsIn(call.title, entries));
  return Object.fromEntries(entries.filter(([key]) => !inTitle.has(key)));
}

function argumentsIn(title: string, entries: [string, unknown][]): string[] {
  const found: string[] = [];
  let rest = title;
  // The longest value first: a number may stand within a sentence that is another argument.
  for (const [key, value] of [...entries].sort((a, b) => String(b[1]).length - String(a[1]).length)) {
    const shorter = withoutMention(rest, value);
    if (shorter === null) continue;
    rest = shorter;
    found.push(key);
  }
  return found;
}

/** The text without one mention of the value; null when it does not mention the value. */
function withoutMention(text: string, value: unknown): string | null {
  for (const form of writtenForms(value)) {
    const escaped = form.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");
    const mention = new RegExp(`(?<![\\p{L}\\p{N}.,-])${escaped}(?![\\p{L}\\p{N}]|[.,]\\p{N})`, "u");
    if (mention.test(text)) return text.replace(mention, "\n");
  }
  return null;
}
