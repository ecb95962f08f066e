/** How this browser calls a person to a question: with a sound, with a notification. Stored in the browser, sent nowhere. */
import { create } from "zustand";
import { readStored, STORAGE, writeStored } from "../browser-storage";
import { isRecord } from "../wire/fields";

export interface AttentionSettings {
  sound: boolean;
  notify: boolean;
}

const DEFAULTS: AttentionSettings = { sound: true, notify: true };

function storedSettings(): AttentionSettings {
  const stored = parseJson(readStored(STORAGE.attention) ?? "{}");
  if (!isRecord(stored)) return DEFAULTS;
  return { sound: stored["sound"] !== false, notify: stored["notify"] !== false };
}

/** Anything can have been stored under our key, by hand or by an older page. */
function parseJson(text: string): unknown {
  try {
    return JSON.parse(text);
  } catch {
    return null;
  }
}

export const useAttentionSettings = create<AttentionSettings>(storedSettings);

export function updateAttentionSettings(settings: Partial<AttentionSettings>): void {
  useAttentionSettings.setState(settings);
  writeStored(STORAGE.attention, JSON.stringify(useAttentionSettings.getState()));
}
