/** What the plots draw: bounded, in order, and honest about gaps. */
import { expect, it } from "vitest";
import { rangeOf, Samples } from "./samples";

it("keeps as many as it may, the newest, oldest first", () => {
  const ring = new Samples(3);
  for (let at = 1; at <= 5; at++) ring.add(at, { speed: at / 10, battery: null, link: at });
  expect(ring.series("speed", 0)).toEqual({ at: [3, 4, 5], values: [0.3, 0.4, 0.5] });
  expect(ring.series("battery", 0).values).toEqual([null, null, null]);
  expect(ring.series("link", 4).at).toEqual([4, 5]);
});

it("tells now, least and most, and leaves gaps out", () => {
  expect(rangeOf({ at: [1, 2, 3], values: [2, null, 1] })).toEqual({ now: 1, least: 1, most: 2 });
  expect(rangeOf({ at: [1, 2], values: [2, null] })).toEqual({ now: null, least: 2, most: 2 });
  expect(rangeOf({ at: [], values: [] })).toEqual({ now: null, least: null, most: null });
});
