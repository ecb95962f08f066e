/** Why the person here cannot send a prompt in the session on the screen right now; null when they can. */
import { canPrompt } from "../state/rights";
import { conversationOf, useMe, useStore } from "../state/store";

export type PromptObstacle = "viewer" | "disconnected" | "opening" | "notOpened" | "running";

export function usePromptObstacle(): PromptObstacle | null {
  const me = useMe();
  const online = useStore((state) => state.link.status === "online");
  const ready = useStore((state) => state.currentId !== null && state.attached.has(state.currentId));
  const notOpened = useStore((state) => state.notOpened !== null);
  const running = useStore((state) => conversationOf(state).turn !== null);
  if (!canPrompt(me.role)) return "viewer";
  if (!online) return "disconnected";
  if (!ready) return notOpened ? "notOpened" : "opening";
  return running ? "running" : null;
}
