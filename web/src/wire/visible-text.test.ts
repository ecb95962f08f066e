/** What nobody sees becomes visible, and every language stays as it is written. */
import { describe, expect, it } from "vitest";
import { visibleLine, visibleText } from "./visible-text";

describe("becomes a mark", () => {
  it.each([
    ["a sentence turned round", "Drive to \u202Eecnartne eht", "Drive to ‹U+202E›ecnartne eht"],
    ["an isolate", "a\u2066b\u2069c", "a‹U+2066›b‹U+2069›c"],
    ["a direction mark", "a\u200Fb\u061Cc", "a‹U+200F›b‹U+061C›c"],
    ["a zero width space", "pass\u200Bword", "pass‹U+200B›word"],
    ["a joiner between Latin letters", "a\u200Db\u200Cc", "a‹U+200D›b‹U+200C›c"],
    ["a byte order mark", "\uFEFFa", "‹U+FEFF›a"],
    ["an escape sequence", "\u001b[2Ja", "‹U+001B›[2Ja"],
    ["a C1 control", "a\u009b2Jb", "a‹U+009B›2Jb"],
    ["a NUL, a bell and a delete", "\0\x07\x7f", "‹U+0000›‹U+0007›‹U+007F›"],
    ["a carriage return", "seen\rhidden", "seen‹U+000D›hidden"],
    ["a line separator", "a\u2028b\u2029c", "a‹U+2028›b‹U+2029›c"],
    ["an invisible tag", "a\u{E0041}b", "a‹U+E0041›b"],
    ["tags after a flag", "\u{1F3F4}\u{E0069}\u{E007F}", "\u{1F3F4}‹U+E0069›‹U+E007F›"],
    ["an invisible letter", "a\u3164b", "a‹U+3164›b"],
    ["half a character", "a\uD800b", "a‹U+D800›b"],
  ])("%s", (_what, text, seen) => {
    expect(visibleText(text)).toBe(seen);
    expect(visibleLine(text)).toBe(seen);
  });
});

describe("stays as it is", () => {
  it.each([
    ["prose of several lines", "One.\n\n\tTwo."],
    ["a family", "👨‍👩‍👧‍👦"],
    ["a heart on fire", "❤️‍🔥"],
    ["somebody with a colour", "👩🏽‍🚀"],
    ["the flag of Wales", "🏴\u{E0067}\u{E0062}\u{E0077}\u{E006C}\u{E0073}\u{E007F}"],
    ["Persian", "می\u200Cخواهم"],
    ["Sinhala", "ශ්\u200Dරී"],
    ["Arabic, Hebrew", "اذهب إلى المختبر · לך למעבדה"],
    ["accents, Chinese, a combining mark", "Ángel · 去实验室 · e\u0301"],
    ["a mark", "‹U+202E›"],
  ])("%s", (_what, text) => expect(visibleText(text)).toBe(text));
});

it("has no line breaks where one line is meant", () => {
  expect(visibleLine("Say hello\nAllowed by Sue\r\n.\tx")).toBe("Say hello↵Allowed by Sue↵. x");
});

it("is quick with a large hostile text", () => {
  expect(visibleText("\u202E".repeat(100_000))).toHaveLength(8 * 100_000);
});
