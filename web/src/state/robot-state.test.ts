/** What the robot is said to be doing. */
import { describe, expect, it } from "vitest";
import { parseTelemetry } from "../wire/telemetry";
import { robotState } from "./robot-state";
import type { LinkState } from "../wire/link-state";

const ONLINE: LinkState = { status: "online" };
const REST = {
  robot: "Sancho",
  online: true,
  pose: { x: 1, y: 2, yaw: 0 },
  twist: { linear: 0, angular: 0 },
  battery: { level: 0.8, charging: false },
  motion: null,
  stop: null,
  speaking: null,
};
const MOTION = {
  kind: "navigate",
  goal: { x: 3, y: 4, yaw: 0 },
  place: "lab 2.3.7",
  distance: 12,
  seconds: 15,
};

const kind = (fields: object): string =>
  robotState(parseTelemetry({ ...REST, ...fields }), ONLINE, null, null, null).kind;

describe("the state of the robot", () => {
  it("is ready when it stands", () => expect(kind({})).toBe("ready"));
  it("is ready, charging, at its dock", () =>
    expect(kind({ battery: { level: 0.8, charging: true } })).toBe("charging"));
  it("is driving, with the place", () => {
    expect(robotState(parseTelemetry({ ...REST, motion: MOTION }), ONLINE, null, null, null)).toEqual({
      kind: "driving",
      place: "lab 2.3.7",
    });
  });
  it("is turning", () => expect(kind({ motion: { ...MOTION, kind: "rotate" } })).toBe("turning"));
  it("is speaking", () => expect(kind({ speaking: "Hello" })).toBe("speaking"));
  it("is not reachable when the agent says so", () => expect(kind({ online: false })).toBe("unreachable"));
  it("is stopped before anything else that is told", () => {
    expect(robotState(parseTelemetry({ ...REST, motion: MOTION }), ONLINE, null, null, "Ana")).toEqual({
      kind: "stopped",
      by: "Ana",
    });
    expect(robotState(null, { status: "connecting", first: true }, null, null, "Ana").kind).toBe("stopped");
  });
  it("is not stopped any more for all that anybody knows, once nothing is heard", () => {
    const lines: LinkState[] = [
      ONLINE,
      { status: "waiting", retryAt: 0 },
      { status: "connecting", first: false },
    ];
    for (const line of lines) expect(robotState(null, line, null, 7, "Ana").kind).toBe("unreachable");
  });
  it("is not reachable without a connection, never an old state", () => {
    expect(robotState(parseTelemetry(REST), { status: "waiting", retryAt: 0 }, null, null, null).kind).toBe(
      "unreachable",
    );
  });
  it("is not reachable when its telemetry has ceased", () => {
    expect(robotState(null, ONLINE, null, 7, null).kind).toBe("unreachable");
  });
  it("is unknown before the first connection", () => {
    expect(robotState(null, { status: "connecting", first: true }, null, null, null).kind).toBe("unknown");
  });
});

describe("telemetry", () => {
  it("that cannot be read is a robot that cannot be reached", () => {
    for (const wrong of [null, 7, "x", [], {}, { online: "yes" }]) {
      expect(parseTelemetry(wrong).online).toBe(false);
    }
  });

  it("drops numbers that are none", () => {
    const parsed = parseTelemetry({ ...REST, pose: { x: "1", y: 2, yaw: 0 }, battery: { level: NaN } });
    expect(parsed.pose).toBeNull();
    expect(parsed.battery).toBeNull();
  });

  it("takes the time of a stop as seconds or as a date", () => {
    const at = Date.parse("2026-11-21T12:00:00Z") / 1000;
    expect(parseTelemetry({ ...REST, stop: { by: "Ana", at } }).stop).toEqual({ by: "Ana", at });
    expect(parseTelemetry({ ...REST, stop: { by: "Ana", at: "2026-11-21T12:00:00Z" } }).stop).toEqual({
      by: "Ana",
      at,
    });
  });
});
