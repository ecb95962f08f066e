/** Why the person here cannot ask for anything right now, in the session on the screen; null when nothing is in the way. */
import { canPrompt } from "../state/rights";
import { conversationOf, useMe, useStore } from "../state/store";

export type PromptObstacle = "viewer" | "disconnected" | "opening" | "running";

export function usePromptObstacle(): PromptObstacle | null {
  const me = useMe();
  const online = useStore((state) => state.link.status === "online");
  const ready = useStore((state) => state.currentId !== null && state.attached.has(state.currentId));
  const running = useStore((state) => conversationOf(state).turn !== null);
  if (!canPrompt(me.role)) return "viewer";
  if (!online) return "disconnected";
  if (!ready) return "opening";
  return running ? "running" : null;
}
