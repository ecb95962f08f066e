/** The text that is being written: outside the field, so that the text survives when the field is rendered anew. */
import { create } from "zustand";
import { useStore } from "../../state/store";

export const useComposerText = create<{ text: string }>(() => ({ text: "" }));

/** Who wrote the text. Stays the same while nobody is logged in: the same person may come back. */
let writer: string | null = null;
export const author = (): string | null => writer;

// Another person than the author begins with an empty field.
useStore.subscribe(({ auth }) => {
  if (auth.status !== "in" || auth.me.name === writer) return;
  writer = auth.me.name;
  useComposerText.setState({ text: "" });
});

export const COMPOSER_ID = "composer";
export const CONVERSATION_ID = "conversation";

/** Where the keyboard goes on: the field, but not where that would open a keyboard over the screen, or where it is off. */
export function focusConversation(): void {
  const field = document.getElementById(COMPOSER_ID) as HTMLTextAreaElement | null;
  const touch = window.matchMedia("(pointer: coarse)").matches;
  if (field !== null && !field.disabled && !touch) field.focus();
  else document.getElementById(CONVERSATION_ID)?.focus({ preventScroll: true });
}

/** Gives a text back to whoever wrote it, before what was written since. */
export function giveBackText(text: string): void {
  useComposerText.setState(({ text: since }) => ({ text: since === "" ? text : `${text}\n${since}` }));
}

/** Puts a suggestion into the field and the focus on it. Nothing is sent. */
export function setComposerText(text: string): void {
  useComposerText.setState({ text });
  document.getElementById(COMPOSER_ID)?.focus();
}
