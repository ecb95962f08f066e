/** What the address of a kiosk can say. */
import { expect, it } from "vitest";
import { kioskSettings } from "./settings";

it("begins with a minute, a map, and no microphone", () => {
  expect(kioskSettings("")).toEqual({ idleMs: 60_000, voice: false, map: true });
});

it("takes what the address says", () => {
  expect(kioskSettings("?rest=90&voice=on&map=off")).toEqual({ idleMs: 90_000, voice: true, map: false });
});

it("keeps to sensible times", () => {
  const rest = (value: string): number => kioskSettings(`?rest=${value}`).idleMs;
  expect([rest("1"), rest("99999"), rest("nonsense"), rest("-5")]).toEqual([20_000, 600_000, 60_000, 60_000]);
});
