/** What the page takes for known, once nothing comes any more over a line that looks open. */
import type { ClientContext, InitializeResponse } from "@agentclientprotocol/sdk";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { getState, INITIAL, setState } from "../../state/store";
import { endConnection, startConnection, reconnectNow } from "./connection";
import { Link, type LinkEvents } from "./link";
import { parseTelemetry } from "../../wire/telemetry";
import { METHODS } from "../../wire/methods";

const DRIVING = parseTelemetry({
  robot: "Sancho",
  online: true,
  twist: { linear: 0.8, angular: 0 },
  motion: { kind: "navigate", place: "kitchen" },
});

let line: LinkEvents;
let probe: ReturnType<typeof vi.fn>;
let drop: ReturnType<typeof vi.fn>;

beforeEach(() => {
  vi.useFakeTimers({ now: 100_000 });
  vi.stubGlobal("fetch", () => new Promise(() => undefined));
  setState(INITIAL);
  // The line itself is open and silent; all else is the page's own.
  vi.spyOn(Link.prototype, "start").mockImplementation(function (this: Link) {
    line = this.events;
    line.onState({ status: "online" });
  });
  probe = vi.spyOn(Link.prototype, "probe").mockResolvedValue();
  drop = vi.spyOn(Link.prototype, "drop").mockReturnValue();
  startConnection({ onOpen: () => Promise.resolve(), onQuestion: () => new Promise(() => undefined) });
});

afterEach(() => {
  endConnection();
  vi.restoreAllMocks();
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

it("is nothing after 3 s, and what comes then", () => {
  line.onTelemetry(DRIVING);
  vi.advanceTimersByTime(2900);
  line.onTelemetry(DRIVING);
  vi.advanceTimersByTime(2900);
  expect(getState()).toMatchObject({ telemetry: DRIVING, silentSince: null });
  vi.advanceTimersByTime(200);
  expect(getState()).toMatchObject({ telemetry: null, silentSince: expect.closeTo(102.9, 1) as number });
  line.onTelemetry(DRIVING);
  expect(getState()).toMatchObject({ telemetry: DRIVING, silentSince: null });
});

it("is what was told of a robot that cannot be reached: that is told once", () => {
  const away = parseTelemetry({ robot: "Sancho", online: false });
  line.onTelemetry(DRIVING);
  line.onTelemetry(away);
  vi.advanceTimersByTime(60_000);
  expect(getState()).toMatchObject({ telemetry: away, silentSince: null });
});

it("is what is heard from an agent that tells nothing of the robot", () => {
  vi.advanceTimersByTime(60_000);
  expect(getState()).toMatchObject({ telemetry: null, silentSince: null });
});

it("ended when it was heard last, although the line was lost later", () => {
  line.onTelemetry(DRIVING);
  vi.advanceTimersByTime(9000);
  line.onLost();
  expect(getState()).toMatchObject({ telemetry: null, silentSince: expect.closeTo(100, 1) as number });
});

it("makes the page ask whether the line is dead, for as long as it lasts", () => {
  line.onTelemetry(DRIVING);
  expect(probe).not.toHaveBeenCalled();
  vi.advanceTimersByTime(3100);
  expect(probe).toHaveBeenCalledOnce();
  vi.advanceTimersByTime(3100);
  expect(probe).toHaveBeenCalledTimes(2);
  line.onTelemetry(parseTelemetry({ robot: "Sancho", online: false }));
  vi.advanceTimersByTime(60_000);
  expect(probe).toHaveBeenCalledTimes(2);
});

it("can be ended by somebody who wants a new line, and a line that brings something is kept", () => {
  line.onTelemetry(DRIVING);
  reconnectNow();
  expect(drop).not.toHaveBeenCalled();
  vi.advanceTimersByTime(3100);
  reconnectNow();
  expect(drop).toHaveBeenCalledOnce();
});

it("ended when the robot was heard last, also when the machine slept meanwhile", () => {
  line.onTelemetry(DRIVING);
  vi.setSystemTime(3_700_000);
  document.dispatchEvent(new Event("visibilitychange"));
  expect(getState()).toMatchObject({ telemetry: null, silentSince: expect.closeTo(100, 1) as number });
  expect(probe).toHaveBeenCalledOnce();
});

it("is not what begins whenever the page is looked at", () => {
  line.onTelemetry(DRIVING);
  vi.advanceTimersByTime(2000);
  window.dispatchEvent(new Event("focus"));
  expect(getState()).toMatchObject({ telemetry: DRIVING, silentSince: null });
});

const opens = (extensions: string[]): void => {
  const hello: InitializeResponse = {
    protocolVersion: 1,
    agentCapabilities: { _meta: { "robot-acp": { extensions } } },
  };
  line.onState({ status: "online" });
  void line.onOpen({} as unknown as ClientContext, hello);
};

it("lasts until something is heard, not until the line is open again", () => {
  line.onTelemetry(DRIVING);
  line.onLost();
  vi.setSystemTime(110_000);
  opens([METHODS.telemetry]);
  expect(getState()).toMatchObject({ telemetry: null, silentSince: expect.closeTo(100, 1) as number });
  vi.advanceTimersByTime(3100);
  expect(probe).toHaveBeenCalledOnce();
  line.onTelemetry(DRIVING);
  expect(getState()).toMatchObject({ telemetry: DRIVING, silentSince: null });
});

it("begins 3 s after an agent that tells of the robot has said hello, if that is all", () => {
  opens([METHODS.telemetry]);
  expect(getState().silentSince).toBeNull();
  vi.advanceTimersByTime(3100);
  expect(getState().silentSince).toBeCloseTo(100, 1);
});

it("is over with an agent that tells nothing of the robot, and does not begin when all was told before", () => {
  line.onLost();
  expect(getState().silentSince).not.toBeNull();
  opens([]);
  expect(getState().silentSince).toBeNull();
  line.onTelemetry(parseTelemetry({ robot: "Sancho", online: false }));
  opens([METHODS.telemetry]);
  vi.advanceTimersByTime(60_000);
  expect(getState().silentSince).toBeNull();
});
