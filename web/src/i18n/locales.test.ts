/** Every language says everything, and with the same values in it: what the types of the texts cannot hold. */
import { describe, expect, it } from "vitest";
import { LANGUAGES } from ".";
import en from "./locales/en";
import es from "./locales/es";

type Texts = Record<string, Record<string, string>>;

/** Words that are the same in another language; anything else that is has been forgotten. */
const OTHERS: Record<string, { texts: Texts; alike: string[] }> = {
  es: { texts: es, alike: ["logKind.plan", "role.supervisor", "talk.plan", "title.plain"] },
};

function flat(texts: Texts): [string, string][] {
  return Object.entries(texts).flatMap(([group, words]) =>
    Object.entries(words).map(([key, text]): [string, string] => [`${group}.${key}`, text]),
  );
}

const PLACEHOLDER = /{{\w+}}/g;
const placeholders = (text: string): string[] => (text.match(PLACEHOLDER) ?? []).sort();

it("no language of the page is left out here", () => {
  expect(LANGUAGES.map(({ code }) => code).sort()).toEqual(["en", ...Object.keys(OTHERS)].sort());
});

describe.each(Object.entries(OTHERS))("the language %s", (_code, { texts, alike }) => {
  it("has the same keys in the same order", () => {
    expect(flat(texts).map(([key]) => key)).toEqual(flat(en).map(([key]) => key));
  });

  it("has no empty text", () => {
    expect(flat(texts).filter(([, text]) => text.trim() === "")).toEqual([]);
  });

  it("has the same placeholders in every text", () => {
    const here = flat(texts).map(([key, text]) => [key, placeholders(text)]);
    expect(here).toEqual(flat(en).map(([key, text]) => [key, placeholders(text)]));
  });

  it("is translated", () => {
    const english = new Map(flat(en));
    const same = flat(texts).filter(
      ([key, text]) => english.get(key) === text && /\p{L}{4}/u.test(text.replace(PLACEHOLDER, "")),
    );
    expect(same.map(([key]) => key).sort()).toEqual(alike);
  });
});
