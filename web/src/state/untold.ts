/**
 * The arguments of a call that its title does not tell: whoever decides must see all of it, and nothing twice. A value
 * counts as told when it stands in the title as a word of its own, once for each argument.
 */
import { isRecord } from "../acp/meta";
import { formsOf } from "../i18n/known";

export function untold(title: string, input: unknown): Record<string, unknown> {
  if (!isRecord(input)) return {};
  const entries = Object.entries(input).filter(([, value]) => value !== null && value !== undefined);
  const told = new Set<string>();
  let rest = title;
  // The longest first: a number may stand in a sentence that is another argument.
  for (const [key, value] of [...entries].sort((a, b) => String(b[1]).length - String(a[1]).length)) {
    const left = without(rest, value);
    if (left === null) continue;
    rest = left;
    told.add(key);
  }
  return Object.fromEntries(entries.filter(([key]) => !told.has(key)));
}

/** The text less one mention of the value; null when it does not mention it. */
function without(text: string, value: unknown): string | null {
  for (const form of formsOf(value)) {
    const escaped = form.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");
    const mention = new RegExp(`(?<![\\p{L}\\p{N}.,-])${escaped}(?![\\p{L}\\p{N}]|[.,]\\p{N})`, "u");
    if (mention.test(text)) return text.replace(mention, "\n");
  }
  return null;
}
