/** Which language the page is in: chosen when it opens, and changed by the person who reads it. */
import { readStored, STORAGE, writeStored } from "../browser-storage";
import { isKiosk } from "../screen";
import i18next, { LANGUAGES } from "./index";

const isLanguage = (code: string | null | undefined): code is string =>
  LANGUAGES.some((language) => language.code === code);

/** The language that a page begins in: a kiosk's address names it, the dashboard's browser stored it; else the browser's own. */
export function initialLanguage(): string {
  const wanted = isKiosk
    ? new URLSearchParams(window.location.search).get("lang")
    : readStored(STORAGE.language);
  if (isLanguage(wanted)) return wanted;
  return navigator.languages.map((tag) => tag.split("-")[0]).find(isLanguage) ?? "en";
}

/** To be called once, before anything is drawn. */
export function startPageLanguage(): void {
  i18next.on("languageChanged", (code) => {
    document.documentElement.lang = code;
  });
  setLanguage(initialLanguage());
}

/** Sets the page's language until the page is loaded again. */
export function setLanguage(code: string): void {
  void i18next.changeLanguage(code);
}

/** Sets the page's language for this visit and those that follow. */
export function setAndStoreLanguage(code: string): void {
  setLanguage(code);
  writeStored(STORAGE.language, code);
}
