/**
 * The texts of the page in the reader's language. A language is one file in `locales/` named for its code, with the
 * keys of `en.ts`; the compiler says which are missing. English is what all others fall back to.
 */
import i18next from "i18next";
import { initReactI18next } from "react-i18next";
import en from "./locales/en";

export type Texts = { [Group in keyof typeof en]: Record<keyof (typeof en)[Group], string> };

declare module "i18next" {
  interface CustomTypeOptions {
    defaultNS: "translation";
    resources: { translation: typeof en };
  }
}

const files = import.meta.glob<{ default: Texts }>("./locales/*.ts", { eager: true });

const resources = Object.fromEntries(
  Object.entries(files).map(([path, file]) => [
    path.replace(/^.*\/(.+)\.ts$/, "$1"),
    { translation: file.default },
  ]),
);

const language =
  navigator.languages.map((tag) => tag.split("-")[0] ?? "").find((code) => code in resources) ?? "en";

void i18next.use(initReactI18next).init({
  resources,
  lng: language,
  fallbackLng: "en",
  interpolation: { escapeValue: false }, // React escapes
  initAsync: false,
});
document.documentElement.lang = language;

export default i18next;
