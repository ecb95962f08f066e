/** The text that is being written: outside the field, so that the text survives when the field is rendered anew. */
import { create } from "zustand";
import { useStore } from "../../state/store";

export const useComposerText = create<{ text: string }>(() => ({ text: "" }));

/** Who wrote the text. Stays the same while nobody is logged in: the same person may come back. */
let author: string | null = null;

// Another person than the author begins with an empty field.
useStore.subscribe(({ auth }) => {
  if (auth.status !== "in" || auth.me.name === author) return;
  author = auth.me.name;
  useComposerText.setState({ text: "" });
});

export const COMPOSER_ID = "composer";

/** Puts a suggestion into the field and the focus on it. Nothing is sent. */
export function setComposerText(text: string): void {
  useComposerText.setState({ text });
  document.getElementById(COMPOSER_ID)?.focus();
}
