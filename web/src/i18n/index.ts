/**
 * The texts of the page in the reader's language. A language is one file in `locales/` named for its code, with the
 * keys of `en.ts`; the compiler and a test say which are missing. English is what all others fall back to.
 */
import i18next from "i18next";
import { initReactI18next } from "react-i18next";
import { isKiosk } from "../screen";
import en from "./locales/en";

export type Texts = { [Group in keyof typeof en]: Record<keyof (typeof en)[Group], string> };

declare module "i18next" {
  interface CustomTypeOptions {
    defaultNS: "translation";
    resources: { translation: typeof en };
  }
}

const KEPT = "robot-acp/language";

const files = import.meta.glob<{ default: Texts }>("./locales/*.ts", { eager: true });

const locales = Object.entries(files).map(([path, file]) => ({
  code: path.replace(/^.*\/(.+)\.ts$/, "$1"),
  texts: file.default,
}));

export interface Language {
  code: string;
  /** In the language itself. */
  name: string;
}

export const LANGUAGES: readonly Language[] = locales.map(({ code, texts }) => ({
  code,
  name: texts.language.name,
}));

const known = (code: string | null | undefined): code is string =>
  LANGUAGES.some((language) => language.code === code);

/** What a screen begins with: the kiosk's address says it, the dashboard remembers it, else it is the browser's. */
export function firstLanguage(): string {
  const wanted = isKiosk ? new URLSearchParams(window.location.search).get("lang") : kept();
  if (known(wanted)) return wanted;
  return navigator.languages.map((tag) => tag.split("-")[0]).find(known) ?? "en";
}

function kept(): string | null {
  try {
    return window.localStorage.getItem(KEPT);
  } catch {
    return null; // a browser may forbid it; then its own language counts
  }
}

/** Speaks another language from now on, until the page is loaded again. */
export function speak(code: string): void {
  void i18next.changeLanguage(code);
}

/** The same, and the next time, too. */
export function speakAlways(code: string): void {
  speak(code);
  try {
    window.localStorage.setItem(KEPT, code);
  } catch {
    // See above.
  }
}

void i18next.use(initReactI18next).init({
  resources: Object.fromEntries(locales.map(({ code, texts }) => [code, { translation: texts }])),
  lng: firstLanguage(),
  fallbackLng: "en",
  interpolation: { escapeValue: false }, // React escapes
  initAsync: false,
});
i18next.on("languageChanged", (code) => {
  document.documentElement.lang = code;
});
document.documentElement.lang = i18next.language;

export default i18next;
