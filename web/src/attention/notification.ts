/**
 * A notification of the browser for a question, while the page is not in front. The browser's own question, whether
 * this page may, is put only when a person has pressed a button for it.
 */
import { create } from "zustand";

const TAG = "robot-acp/question/";

export type Allowance = "granted" | "denied" | "default" | "none";

function allowance(): Allowance {
  return "Notification" in window ? Notification.permission : "none";
}

/** What the browser lets this page do; "none" where it knows no notifications. */
export const useAllowance = create<{ allowance: Allowance }>(() => ({ allowance: allowance() }));

/** Only from a button. */
export async function askAllowance(): Promise<void> {
  if ("Notification" in window) await Notification.requestPermission();
  useAllowance.setState({ allowance: allowance() });
}

export function isInFront(): boolean {
  return document.visibilityState === "visible" && document.hasFocus();
}

/** Shows one, in the place of an earlier one of this name, also of another tab. Returns what takes it away. */
export function notify(name: string, title: string, body: string, onClick: () => void): () => void {
  if (allowance() !== "granted") return () => undefined;
  try {
    const shown = new Notification(title, { body, tag: TAG + name, requireInteraction: true });
    shown.onclick = () => {
      window.focus();
      shown.close();
      onClick();
    };
    return () => shown.close();
  } catch {
    // Browsers of phones let only a service worker show one.
    useAllowance.setState({ allowance: "none" });
    return () => undefined;
  }
}
