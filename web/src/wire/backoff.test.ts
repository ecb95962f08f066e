/** The pauses between attempts. */
import { expect, it } from "vitest";
import { backoff } from "./backoff";

it("begins at half a second, doubles, and ends at five", () => {
  expect([0, 1, 2, 3, 4, 20].map((attempt) => backoff(attempt, 0.5))).toEqual([
    500, 1000, 2000, 4000, 5000, 5000,
  ]);
});

it("leaves a fifth to chance and stays within its bounds", () => {
  expect(backoff(1, 0)).toBe(800);
  expect(backoff(1, 1)).toBe(1200);
  for (let attempt = 0; attempt < 12; attempt++) {
    for (const random of [0, 0.3, 0.999]) {
      expect(backoff(attempt, random)).toBeGreaterThanOrEqual(500);
      expect(backoff(attempt, random)).toBeLessThanOrEqual(5000);
    }
  }
});
