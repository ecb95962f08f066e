/** A time says of which day it is, unless that is today. */
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { clock } from "./format";

const at = (year: number, day: number): number => new Date(year, 10, day, 9).getTime() / 1000;

beforeEach(() => {
  vi.useFakeTimers();
  vi.setSystemTime(new Date(2026, 10, 22, 14));
});

afterEach(() => vi.useRealTimers());

it.each([
  [2026, 22, false, false],
  [2026, 21, true, false],
  [2025, 22, true, true],
])("%d, day %d of the month", (year, day, hasDay, hasYear) => {
  const text = clock(at(year, day));
  expect(text).toMatch(/9:00:00/);
  expect(text.includes("Nov")).toBe(hasDay);
  expect(text.includes("2025")).toBe(hasYear);
});
