/**
 * The conversation on the screen, for components that draw all of it: updated at most once a frame, however many updates
 * come in that time. A page that is not visible gets no frames, so nothing is drawn.
 */
import { useSyncExternalStore } from "react";
import type { Conversation } from "../state/conversation/conversation";
import { conversationOf, getState, useStore } from "../state/store";

export function useConversation(): Conversation {
  return useSyncExternalStore(onEachFrame, () => conversationOf(getState()));
}

function onEachFrame(onChange: () => void): () => void {
  let frame: number | null = null;
  const end = useStore.subscribe(() => {
    frame ??= requestAnimationFrame(() => {
      frame = null;
      onChange();
    });
  });
  return () => {
    end();
    if (frame !== null) cancelAnimationFrame(frame);
  };
}
