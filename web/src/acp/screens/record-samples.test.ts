/** What is taken for the plots, and how often. */
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { INITIAL, setState } from "../../state/store";
import { recordSamples, samples } from "./record-samples";
import { parseTelemetry } from "../../wire/telemetry";

beforeEach(() => {
  vi.useFakeTimers({ now: 1_000_000 });
  setState(INITIAL);
});
afterEach(() => vi.useRealTimers());

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
  setState({ latencyMs: 12 });
  vi.advanceTimersByTime(600);
  tell(0);
  expect(samples.series("link", begun).values.at(-1)).toBe(12);
  setState({ latencyMs: null });
  expect(samples.series("link", begun).values.at(-1)).toBeNull();
  setState({ telemetry: null });
  end();
  tell(1);
  expect(samples.series("speed", begun).values.at(-1)).toBeNull();
});
