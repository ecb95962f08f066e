/** What every test needs: the texts in English, and time limits that a busy machine keeps to. */
import "./i18n";
import { vi } from "vitest";

// Every wait is for a condition; how long it takes says how busy the machine is.
vi.setConfig({ testTimeout: 60_000 });

// Node 20 has no navigator; the format of numbers asks it for the reader's region.
if (!Reflect.has(globalThis, "navigator")) {
  Object.defineProperty(globalThis, "navigator", { value: { languages: ["en-US"] } });
}
