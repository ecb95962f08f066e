/**
 * Texts of people, models and tools as others may read them: characters that nobody sees, and that can turn a sentence
 * round, hide a part of it or forge a line, become visible marks such as ‹U+202E›. The writer's language stays readable.
 */

/** The flags of England, Scotland and Wales are spelt with invisible letters. */
const FLAG = "\\u{1F3F4}\\u{E0067}\\u{E0062}[\\u{E0061}-\\u{E007A}]{3}\\u{E007F}";
/** Invisible letters and marks, which Unicode does not count among the control and format characters. */
const INVISIBLE = "\\u034F|\\u115F|\\u1160|\\u17B4|\\u17B5|\\u3164|\\uFFA0";
const UNSEEN = new RegExp(`${FLAG}|\\r\\n|[\\p{Cc}\\p{Cf}\\p{Cs}\\p{Zl}\\p{Zp}]|${INVISIBLE}`, "gu");

/** Format characters that are seen: signs around numbers in Arabic, Syriac and Kaithi. */
const SEEN = /[\u0600-\u0605]|\u06DD|\u070F|\u0890|\u0891|\u08E2|\u{110BD}|\u{110CD}/u;

/** Zero width joiner and non-joiner are part of the spelling in these scripts. */
const SCRIPTS =
  "Arabic Syriac Nko Mongolian Devanagari Bengali Gurmukhi Gujarati Oriya Tamil Telugu Kannada Malayalam Sinhala Myanmar Khmer Tibetan";
const LETTERS = SCRIPTS.split(" ")
  .map((script) => `\\p{Script=${script}}`)
  .join("");
const AFTER_LETTER = new RegExp(`[${LETTERS}]$`, "u");
const BEFORE_LETTER = new RegExp(`^[${LETTERS}]`, "u");
const AFTER_EMOJI = /\p{Extended_Pictographic}(?:\uFE0F|\p{Emoji_Modifier})?$/u;
const BEFORE_EMOJI = /^\p{Extended_Pictographic}/u;
/** Characters on each side that decide over a joiner: an emoji with its colour has four. */
const NEAR = 4;

/** A text of several lines. */
export function visibleText(text: string): string {
  return marked(text, "\n", "\t");
}

/** A text that stands in one line, as a name or a title: a line break becomes a mark. */
export function visibleLine(text: string): string {
  return marked(text, "↵", " ");
}

function marked(text: string, lineBreak: string, tab: string): string {
  return text.replace(UNSEEN, (found: string, at: number) => {
    if (found === "\n" || found === "\r\n") return lineBreak;
    if (found === "\t") return tab;
    if (found.length > 2 || SEEN.test(found)) return found;
    const isJoiner = found === "\u200C" || found === "\u200D";
    if (isJoiner && joins(found, text.slice(Math.max(0, at - NEAR), at), text.slice(at + 1, at + 1 + NEAR)))
      return found;
    return `‹U+${(found.codePointAt(0) ?? 0).toString(16).toUpperCase().padStart(4, "0")}›`;
  });
}

function joins(joiner: string, before: string, after: string): boolean {
  if (AFTER_LETTER.test(before) && BEFORE_LETTER.test(after)) return true;
  return joiner === "\u200D" && AFTER_EMOJI.test(before) && BEFORE_EMOJI.test(after);
}
