/**
 * The conversation on the screen, for what draws all of it: at most once a frame, however many words come in that time.
 * While the page is not seen there are no frames, and nothing is drawn.
 */
import { useSyncExternalStore } from "react";
import type { Conversation } from "../state/conversation/conversation";
import { conversationOf, getState, useStore } from "../state/store";

export function useConversation(): Conversation {
  return useSyncExternalStore(eachFrame, () => conversationOf(getState()));
}

function eachFrame(changed: () => void): () => void {
  let frame: number | null = null;
  const end = useStore.subscribe(() => {
    frame ??= requestAnimationFrame(() => {
      frame = null;
      changed();
    });
  });
  return () => {
    end();
    if (frame !== null) cancelAnimationFrame(frame);
  };
}
