/** What the page takes for known, once nothing comes any more over a line that looks open. */
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { getState, INITIAL, setState } from "../state/store";
import { end, start } from "./connection";
import { Link, type LinkEvents } from "./link";
import { parseTelemetry } from "./telemetry";

const DRIVING = parseTelemetry({
  robot: "Sancho",
  online: true,
  twist: { linear: 0.8, angular: 0 },
  motion: { kind: "navigate", place: "kitchen" },
});

let line: LinkEvents;

beforeEach(() => {
  vi.useFakeTimers({ now: 100_000 });
  vi.stubGlobal("fetch", () => new Promise(() => undefined));
  setState(INITIAL);
  // The line itself is open and silent; all else is the page's own.
  vi.spyOn(Link.prototype, "start").mockImplementation(function (this: Link) {
    line = this.events;
    line.onState({ status: "online" });
  });
  start({ onOpen: () => Promise.resolve(), onQuestion: () => new Promise(() => undefined) });
});

afterEach(() => {
  end();
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

it("is nothing after 3 s, and what comes then", () => {
  line.onTelemetry(DRIVING);
  vi.advanceTimersByTime(2900);
  line.onTelemetry(DRIVING);
  vi.advanceTimersByTime(2900);
  expect(getState()).toMatchObject({ telemetry: DRIVING, heardUntil: null });
  vi.advanceTimersByTime(200);
  expect(getState()).toMatchObject({ telemetry: null, heardUntil: expect.closeTo(102.9, 1) as number });
  line.onTelemetry(DRIVING);
  expect(getState()).toMatchObject({ telemetry: DRIVING, heardUntil: null });
});

it("is what was told of a robot that cannot be reached: that is told once", () => {
  const away = parseTelemetry({ robot: "Sancho", online: false });
  line.onTelemetry(DRIVING);
  line.onTelemetry(away);
  vi.advanceTimersByTime(60_000);
  expect(getState()).toMatchObject({ telemetry: away, heardUntil: null });
});

it("is what is heard from an agent that tells nothing of the robot", () => {
  vi.advanceTimersByTime(60_000);
  expect(getState()).toMatchObject({ telemetry: null, heardUntil: null });
});

it("ended when it was heard last, although the line was lost later", () => {
  line.onTelemetry(DRIVING);
  vi.advanceTimersByTime(9000);
  line.onLost();
  expect(getState()).toMatchObject({ telemetry: null, heardUntil: expect.closeTo(100, 1) as number });
});
