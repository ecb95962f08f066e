/** The text that is being written: kept apart from the field, so that nothing that happens to the field loses it. */
import { create } from "zustand";
import { useStore } from "../../state/store";

export const useComposerText = create<{ text: string }>(() => ({ text: "" }));

/** Who writes it; kept while nobody is logged in, for they may come back. */
let author: string | null = null;

// Nobody finds the half-written order of somebody else.
useStore.subscribe(({ auth }) => {
  if (auth.status !== "in" || auth.me.name === author) return;
  author = auth.me.name;
  useComposerText.setState({ text: "" });
});

export const COMPOSER_ID = "composer";

/** Puts a suggestion into the field and the person into the field; sending stays a decision of its own. */
export function setComposerText(text: string): void {
  useComposerText.setState({ text });
  document.getElementById(COMPOSER_ID)?.focus();
}
