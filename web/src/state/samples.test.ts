/** What the plots draw: bounded, in order, and honest about gaps. */
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { parseTelemetry } from "../acp/telemetry";
import { rangeOf, recordSamples, Samples, samples } from "./samples";
import { INITIAL, setState } from "./store";

beforeEach(() => {
  vi.useFakeTimers({ now: 1_000_000 });
  setState(INITIAL);
});
afterEach(() => vi.useRealTimers());

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

it("takes at most two samples a second, and a lost robot at once", () => {
  const end = recordSamples();
  const tell = (linear: number): void =>
    setState({
      telemetry: parseTelemetry({ online: true, twist: { linear, angular: 0 }, battery: { level: 0.5 } }),
    });
  const begun = Date.now() / 1000;
  for (let number = 0; number < 20; number++) {
    tell(-0.5);
    vi.advanceTimersByTime(100);
  }
  const { values } = samples.series("speed", begun);
  expect(values.length).toBeLessThanOrEqual(5);
  expect(values.every((value) => value === 0.5)).toBe(true);
  setState({ telemetry: null });
  expect(samples.series("speed", begun).values.at(-1)).toBeNull();
  end();
  tell(1);
  expect(samples.series("speed", begun).values.at(-1)).toBeNull();
});
