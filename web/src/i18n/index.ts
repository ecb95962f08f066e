/**
 * The texts of the page in the reader's language. A language is one file in `locales/` named for its code, with the
 * keys of `en.ts`; the compiler and a test say which are missing. A text that is missing all the same is shown in English.
 * Which language a page has is decided in `page-language.ts`.
 */
import i18next from "i18next";
import { initReactI18next } from "react-i18next";
import { visibleLine } from "../wire/visible-text";
import en from "./locales/en";

export type Texts = { [Group in keyof typeof en]: Record<keyof (typeof en)[Group], string> };

declare module "i18next" {
  interface CustomTypeOptions {
    defaultNS: "translation";
    resources: { translation: typeof en };
  }
}

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

void i18next.use(initReactI18next).init({
  resources: Object.fromEntries(locales.map(({ code, texts }) => [code, { translation: texts }])),
  lng: "en",
  fallbackLng: "en",
  // React escapes HTML. What is said of others' names and titles must be what people see.
  interpolation: { escapeValue: true, escape: visibleLine },
  initAsync: false,
});

export default i18next;
