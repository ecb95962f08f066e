/** What stands at the top of the screen: the gravest first, two at most unless more are grave, and nothing about a robot that nobody hears. */
import { describe, expect, it } from "vitest";
import { parseTelemetry, type Telemetry } from "../wire/telemetry";
import { alerts, keepHidden } from "./alerts";
import { INITIAL, type State, type HiddenAlerts } from "./store";

const NOTHING: HiddenAlerts = { halted: null, battery: null };
const HALTED = { code: "blocked", text: "Something came into the robot's way.", at: 7 };

function robot(battery: object, more: object = {}): Telemetry {
  return parseTelemetry({
    robot: "Sancho",
    online: true,
    battery: { charging: false, floor: 0.1, ...battery },
    ...more,
  });
}

function shown(state: Partial<State>, hidden = NOTHING): string[] {
  return alerts({ ...INITIAL, link: { status: "online" }, hidden, ...state });
}

describe("alerts", () => {
  it("are none while all is well", () => {
    expect(shown({ telemetry: robot({ level: 0.9 }) })).toEqual([]);
    expect(alerts({ ...INITIAL, link: { status: "connecting", first: true } })).toEqual([]);
  });

  it("tell of a motion that ended by itself until it is hidden, and of the next one again", () => {
    const telemetry = robot({ level: 0.9 }, { halted: HALTED });
    expect(shown({ telemetry })).toEqual(["halted"]);
    expect(shown({ telemetry }, { ...NOTHING, halted: 7 })).toEqual([]);
    expect(shown({ telemetry }, { ...NOTHING, halted: 6 })).toEqual(["halted"]);
  });

  it("tell of a stop and not of what it made old", () => {
    const telemetry = robot({ level: 0.9 }, { halted: HALTED });
    expect(shown({ telemetry, stop: { by: "Ana", at: 8 } })).toEqual(["stopped"]);
  });

  it.each([
    [0.21, false, []],
    [0.2, false, ["battery"]],
    [0.05, false, ["battery"]],
    [0.05, true, []],
  ])("at a charge of %d, charging %s: %j", (level, charging, expected) => {
    expect(shown({ telemetry: robot({ level, charging }) })).toEqual(expected);
  });

  it("count a floor that is higher than a fifth", () => {
    expect(shown({ telemetry: robot({ level: 0.28, floor: 0.3 }) })).toEqual(["battery"]);
  });

  it.each([
    [0.17, []],
    [0.13, ["battery"]],
  ])("once hidden at 18 %% come back at %d: %j", (level, expected) => {
    expect(shown({ telemetry: robot({ level }) }, { ...NOTHING, battery: 0.18 })).toEqual(expected);
  });

  it("stay hidden while nobody knows how the battery is, and come back once it had recovered", () => {
    const hidden = { halted: 7, battery: 0.18 };
    for (const unknown of [null, parseTelemetry({ online: false }), robot({ level: 0.18 })]) {
      expect(keepHidden(hidden, unknown)).toBe(hidden);
    }
    expect(keepHidden(hidden, robot({ level: 0.18, charging: true }))).toEqual({ halted: 7, battery: null });
    expect(keepHidden(hidden, robot({ level: 0.5 }))).toEqual({ halted: 7, battery: null });
  });

  it("come back when the battery falls below its floor", () => {
    expect(shown({ telemetry: robot({ level: 0.099 }) }, { ...NOTHING, battery: 0.11 })).toEqual(["battery"]);
    expect(shown({ telemetry: robot({ level: 0.099 }) }, { ...NOTHING, battery: 0.1 })).toEqual(["battery"]);
    expect(shown({ telemetry: robot({ level: 0.098 }) }, { ...NOTHING, battery: 0.099 })).toEqual([]);
  });

  it("say that the line is cut, and nothing of the robot then", () => {
    expect(shown({ link: { status: "waiting", retryAt: 1 } })).toEqual(["cut"]);
    expect(shown({ link: { status: "connecting", first: false } })).toEqual(["cut"]);
    expect(shown({ telemetry: parseTelemetry({ online: false }) })).toEqual(["robot-lost"]);
  });

  it("say that nothing is heard of the robot, and why as far as anybody knows", () => {
    expect(shown({ silentSince: 7 })).toEqual(["silent"]);
    expect(shown({ silentSince: 7, reachable: false })).toEqual(["cut"]);
    expect(shown({ telemetry: parseTelemetry({ online: false }), reachable: false })).toEqual(["cut"]);
    const down = { agent: { up: true, detail: "" }, robot: { up: false, detail: "" }, robotName: null };
    expect(shown({ health: down, reachable: false })).toEqual(["cut"]);
    expect(shown({ health: down, silentSince: 7 })).toEqual(["robot-lost"]);
    expect(shown({ telemetry: robot({ level: 0.9 }), reachable: false })).toEqual([]);
  });

  it("say that the database is away beside whatever else is, and only while the agent is heard", () => {
    const database = { text: "The session log cannot be written.", at: 1_800_000_000 };
    const telemetry = robot({ level: 0.9 }, { database });
    expect(shown({ telemetry })).toEqual(["database"]);
    expect(shown({ telemetry: robot({ level: 0.9 }, { database: null }) })).toEqual([]);
    const noRobot = parseTelemetry({ robot: "Sancho", online: false, database });
    expect(noRobot.database).toEqual(database);
    expect(shown({ telemetry: noRobot })).toEqual(["robot-lost", "database"]);
    expect(shown({ telemetry, stop: { by: "Ana", at: 1 } })).toEqual(["stopped", "database"]);
    expect(shown({ telemetry, silentSince: 7 })).toEqual(["silent"]);
    expect(shown({ telemetry, link: { status: "waiting", retryAt: 1 } })).toEqual(["cut"]);
  });

  it("are two at most, and what is grave is among them", () => {
    const telemetry = robot({ level: 0.05 }, { halted: HALTED });
    expect(shown({ telemetry })).toEqual(["halted", "battery"]);
    expect(shown({ telemetry, stopError: { kind: "noAnswer" }, stop: { by: "Ana", at: 1 } })).toEqual([
      "stop-failed",
      "stopped",
    ]);
    expect(shown({ telemetry, stop: { by: "Ana", at: 1 } })).toEqual(["stopped", "battery"]);
    expect(
      shown({ silentSince: 7, stopError: { kind: "noAnswer" }, stop: { by: "Ana", at: 1 } }),
    ).toHaveLength(3);
  });
});
