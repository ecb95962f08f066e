/**
 * What this browser remembers from one visit to the next: the keys, each written here and nowhere else. A browser may
 * forbid its storage; then nothing is read, and what is written lasts until the page is loaded again.
 */

export const STORAGE = {
  attention: "robot-acp/attention",
  camera: "robot-acp/camera",
  language: "robot-acp/language",
  lastSession: "robot-acp/last-session",
} as const;

/** Whether the activity panel is open, by layout: a choice made on a wide window says nothing of a tablet. */
export const activityStorageKey = (layout: string): string => `robot-acp/activity-${layout}`;

/** Null where nothing is stored, or nothing can be read. */
export function readStored(key: string): string | null {
  try {
    return window.localStorage.getItem(key);
  } catch {
    return null;
  }
}

export function writeStored(key: string, value: string): void {
  try {
    window.localStorage.setItem(key, value);
  } catch {
    // Storage is forbidden or full; nothing depends on it.
  }
}

export function removeStored(key: string): void {
  try {
    window.localStorage.removeItem(key);
  } catch {
    // Storage is forbidden; then nothing was stored.
  }
}
