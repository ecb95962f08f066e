/**
 * A notification of the browser for a question, while the page is not in front. The page asks the browser for the
 * permission only when a person has pressed a button for it.
 */
import { create } from "zustand";

/** Precedes the name of a question. A notification takes the place of one with the same tag, also of another tab. */
const TAG_PREFIX = "robot-acp/question/";

/** "none" where the browser has no notifications. */
export type PermissionState = "granted" | "denied" | "default" | "none";

function currentPermission(): PermissionState {
  return "Notification" in window ? Notification.permission : "none";
}

/** What the browser allows this page. */
export const useNotificationPermission = create<{ permission: PermissionState }>(() => ({
  permission: currentPermission(),
}));

/** To be called only from a button that a person has pressed. */
export async function requestNotificationPermission(): Promise<void> {
  if ("Notification" in window) await Notification.requestPermission();
  useNotificationPermission.setState({ permission: currentPermission() });
}

export function isInFront(): boolean {
  return document.visibilityState === "visible" && document.hasFocus();
}

/** Shows a notification, or nothing where that is not allowed. Returns a function that closes it. */
export function notify(name: string, title: string, body: string, onClick: () => void): () => void {
  if (currentPermission() !== "granted") return () => undefined;
  try {
    const notification = new Notification(title, { body, tag: TAG_PREFIX + name, requireInteraction: true });
    notification.onclick = () => {
      window.focus();
      notification.close();
      onClick();
    };
    return () => notification.close();
  } catch {
    // Browsers of phones let only a service worker show notifications.
    useNotificationPermission.setState({ permission: "none" });
    return () => undefined;
  }
}
