/** No two requests at a time, and the next one only after a pause. */
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { Poll } from "./poll";

let signals: AbortSignal[];
let finish: (() => void)[];
let poll: Poll;

beforeEach(() => {
  vi.useFakeTimers();
  signals = [];
  finish = [];
  poll = new Poll((signal) => {
    signals.push(signal);
    return new Promise((resolve) => finish.push(resolve));
  }, 5000);
});

afterEach(() => {
  poll.end();
  vi.useRealTimers();
});

async function passes(ms: number): Promise<void> {
  await vi.advanceTimersByTimeAsync(ms);
}

it("asks again after its time, counted from the beginning of the request", async () => {
  poll.now();
  await passes(2000);
  finish[0]?.();
  await passes(2999);
  expect(signals).toHaveLength(1);
  await passes(1);
  expect(signals).toHaveLength(2);
});

it("waits for a slow request however long it takes, and pauses after it", async () => {
  poll.now();
  await passes(60_000);
  expect(signals).toHaveLength(1);
  finish[0]?.();
  await passes(999);
  expect(signals).toHaveLength(1);
  await passes(1);
  expect(signals).toHaveLength(2);
});

it("gives the request up when it asks anew, and goes on from the new one alone", async () => {
  poll.now();
  poll.now();
  expect(signals.map(({ aborted }) => aborted)).toEqual([true, false]);
  finish[0]?.();
  await passes(60_000);
  expect(signals).toHaveLength(2);
  finish[1]?.();
  await passes(1000);
  expect(signals).toHaveLength(3);
});

it("leaves a request that is under way alone where there is no hurry", () => {
  poll.soon();
  poll.soon();
  expect(signals.map(({ aborted }) => aborted)).toEqual([false]);
});

it("asks nothing after its end", async () => {
  poll.now();
  poll.end();
  expect(signals[0]?.aborted).toBe(true);
  finish[0]?.();
  await passes(60_000);
  expect(signals).toHaveLength(1);
  expect(vi.getTimerCount()).toBe(0);
});

it("goes on after a request that failed", async () => {
  poll = new Poll((signal) => {
    signals.push(signal);
    return Promise.reject(new Error("no"));
  }, 5000);
  poll.now();
  await passes(5000);
  expect(signals).toHaveLength(2);
});
