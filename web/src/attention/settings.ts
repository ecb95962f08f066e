/** How a question calls for a person in this browser: with a sound, with a notification. Remembered, and told to nobody. */
import { create } from "zustand";
import { isRecord } from "../wire/meta";

const KEPT = "robot-acp/attention";

export interface AttentionSettings {
  sound: boolean;
  notify: boolean;
}

const DEFAULTS: AttentionSettings = { sound: true, notify: true };

function kept(): AttentionSettings {
  try {
    const told: unknown = JSON.parse(window.localStorage.getItem(KEPT) ?? "{}");
    if (!isRecord(told)) return DEFAULTS;
    return { sound: told["sound"] !== false, notify: told["notify"] !== false };
  } catch {
    return DEFAULTS; // a browser may forbid it, and anybody may have written there
  }
}

export const useAttentionSettings = create<AttentionSettings>(kept);

export function change(settings: Partial<AttentionSettings>): void {
  useAttentionSettings.setState(settings);
  try {
    window.localStorage.setItem(KEPT, JSON.stringify(useAttentionSettings.getState()));
  } catch {
    // Then it counts until the page is loaded again.
  }
}
