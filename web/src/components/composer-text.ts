/** The text that is being written: kept apart from the field, so that nothing that happens to the field loses it. */
import { create } from "zustand";

export const useComposerText = create<{ text: string }>(() => ({ text: "" }));

export const COMPOSER_ID = "composer";

/** Puts a suggestion into the field and the person into the field; sending stays a decision of its own. */
export function setComposerText(text: string): void {
  useComposerText.setState({ text });
  document.getElementById(COMPOSER_ID)?.focus();
}
