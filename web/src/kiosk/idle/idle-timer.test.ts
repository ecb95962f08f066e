/** The minute after which a kiosk starts over. */
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { IdleTimer } from "./idle-timer";

const onWarn = vi.fn<(at: number | null) => void>();
const onEnd = vi.fn();
let timer: IdleTimer;

const warned = (): boolean => typeof onWarn.mock.lastCall?.[0] === "number";

beforeEach(() => {
  vi.useFakeTimers();
  onWarn.mockReset();
  onEnd.mockReset();
  timer = new IdleTimer(60_000, 20_000, { onWarn, onEnd });
});

afterEach(() => {
  timer.dispose();
  vi.useRealTimers();
});

it("warns twenty seconds before the minute is over, and then it is over", () => {
  vi.advanceTimersByTime(39_999);
  expect(warned()).toBe(false);
  vi.advanceTimersByTime(1);
  expect(onWarn.mock.lastCall?.[0]).toBe(Date.now() + 20_000);
  vi.advanceTimersByTime(19_999);
  expect(onEnd).not.toHaveBeenCalled();
  vi.advanceTimersByTime(1);
  expect(onEnd).toHaveBeenCalledOnce();
  expect(warned()).toBe(false);
});

it("begins anew with every touch, also during the warning", () => {
  for (let i = 0; i < 10; i++) {
    vi.advanceTimersByTime(50_000);
    expect(warned()).toBe(true);
    timer.restart();
    expect(warned()).toBe(false);
  }
  expect(onEnd).not.toHaveBeenCalled();
});

it("does not count while something runs, and counts from its end", () => {
  vi.advanceTimersByTime(45_000);
  timer.setPaused(true);
  expect(warned()).toBe(false);
  vi.advanceTimersByTime(600_000);
  timer.restart();
  vi.advanceTimersByTime(600_000);
  expect(onEnd).not.toHaveBeenCalled();
  timer.setPaused(false);
  vi.advanceTimersByTime(59_999);
  expect(onEnd).not.toHaveBeenCalled();
  vi.advanceTimersByTime(1);
  expect(onEnd).toHaveBeenCalledOnce();
});

it("goes on for days, once a minute", () => {
  vi.advanceTimersByTime(24 * 3_600_000);
  expect(onEnd).toHaveBeenCalledTimes(24 * 60);
  expect(vi.getTimerCount()).toBe(1);
});

it("is quiet after its end", () => {
  timer.dispose();
  vi.advanceTimersByTime(600_000);
  expect(onEnd).not.toHaveBeenCalled();
  expect(vi.getTimerCount()).toBe(0);
});
