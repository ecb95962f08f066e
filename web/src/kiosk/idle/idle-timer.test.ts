/** The minute after which a kiosk starts over. */
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { IdleTimer } from "./idle-timer";

const onWarn = vi.fn<(at: number | null) => void>();
const onOver = vi.fn();
let rest: IdleTimer;

const warned = (): boolean => typeof onWarn.mock.lastCall?.[0] === "number";

beforeEach(() => {
  vi.useFakeTimers();
  onWarn.mockReset();
  onOver.mockReset();
  rest = new IdleTimer(60_000, 20_000, { onWarn, onOver });
});

afterEach(() => {
  rest.end();
  vi.useRealTimers();
});

it("warns twenty seconds before the minute is over, and then it is over", () => {
  vi.advanceTimersByTime(39_999);
  expect(warned()).toBe(false);
  vi.advanceTimersByTime(1);
  expect(onWarn.mock.lastCall?.[0]).toBe(Date.now() + 20_000);
  vi.advanceTimersByTime(19_999);
  expect(onOver).not.toHaveBeenCalled();
  vi.advanceTimersByTime(1);
  expect(onOver).toHaveBeenCalledOnce();
  expect(warned()).toBe(false);
});

it("begins anew with every touch, also during the warning", () => {
  for (let i = 0; i < 10; i++) {
    vi.advanceTimersByTime(50_000);
    expect(warned()).toBe(true);
    rest.touch();
    expect(warned()).toBe(false);
  }
  expect(onOver).not.toHaveBeenCalled();
});

it("does not count while something runs, and counts from its end", () => {
  vi.advanceTimersByTime(45_000);
  rest.hold(true);
  expect(warned()).toBe(false);
  vi.advanceTimersByTime(600_000);
  rest.touch();
  vi.advanceTimersByTime(600_000);
  expect(onOver).not.toHaveBeenCalled();
  rest.hold(false);
  vi.advanceTimersByTime(59_999);
  expect(onOver).not.toHaveBeenCalled();
  vi.advanceTimersByTime(1);
  expect(onOver).toHaveBeenCalledOnce();
});

it("goes on for days, once a minute", () => {
  vi.advanceTimersByTime(24 * 3_600_000);
  expect(onOver).toHaveBeenCalledTimes(24 * 60);
  expect(vi.getTimerCount()).toBe(1);
});

it("is quiet after its end", () => {
  rest.end();
  vi.advanceTimersByTime(600_000);
  expect(onOver).not.toHaveBeenCalled();
  expect(vi.getTimerCount()).toBe(0);
});
