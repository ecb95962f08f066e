/** A socket that is kept up: it comes back by itself, gently, and not once it has been ended. */
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { FakeSocket } from "./fake-socket";
import { ReconnectingSocket } from "./reconnecting-socket";

beforeEach(() => {
  vi.useFakeTimers();
  vi.stubGlobal("WebSocket", FakeSocket);
  FakeSocket.all = [];
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

it("dials its path on the page's own address", () => {
  new ReconnectingSocket("/camera", { onMessage: vi.fn() }).end();
  expect(FakeSocket.last.url).toBe(`ws://${window.location.host}/camera`);
});

it("is opened again when it is lost", () => {
  const onLost = vi.fn();
  const kept = new ReconnectingSocket("/camera", { onMessage: vi.fn(), onLost });
  FakeSocket.last.opens();
  FakeSocket.last.closes();
  expect(onLost).toHaveBeenCalledOnce();
  vi.advanceTimersToNextTimer();
  expect(FakeSocket.all).toHaveLength(2);
  kept.end();
});

it("waits longer each time while nothing comes of it, even when the server lets it in", () => {
  const kept = new ReconnectingSocket("/camera", { onMessage: vi.fn() });
  const pauses = [0, 1, 2, 3].map(() => {
    FakeSocket.last.opens();
    FakeSocket.last.closes();
    const before = Date.now();
    vi.advanceTimersToNextTimer();
    return Date.now() - before;
  });
  expect(pauses).toEqual([...pauses].sort((one, other) => one - other));
  expect(pauses.at(-1)).toBeGreaterThan(2000);
  FakeSocket.last.tells("something");
  FakeSocket.last.closes();
  vi.advanceTimersByTime(700);
  expect(FakeSocket.all).toHaveLength(6);
  kept.end();
});

it("does not come back once it has been ended, and what comes late is not heard", () => {
  const onMessage = vi.fn();
  const kept = new ReconnectingSocket("/camera", { onMessage });
  FakeSocket.last.opens();
  kept.end();
  FakeSocket.last.tells("late");
  FakeSocket.last.closes();
  vi.runAllTimers();
  expect(onMessage).not.toHaveBeenCalled();
  expect(FakeSocket.all).toHaveLength(1);
});

it("gives up a dead connection without waiting for its end", () => {
  const onLost = vi.fn();
  const kept = new ReconnectingSocket("/camera", { onMessage: vi.fn(), onLost });
  FakeSocket.last.opens();
  const dead = FakeSocket.last;
  kept.drop();
  vi.advanceTimersToNextTimer();
  dead.closes();
  expect(onLost).toHaveBeenCalledOnce();
  expect(FakeSocket.all).toHaveLength(2);
  kept.end();
});
