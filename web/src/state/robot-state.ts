/** What the robot is doing, as one of a fixed list of states: computed from the store, never stored. */
import { isCutOff } from "../wire/link-state";
import type { Telemetry } from "../wire/telemetry";
import type { Health } from "../wire/bridge";
import type { LinkState } from "../wire/link-state";

export type RobotState =
  | { kind: "unknown" }
  | { kind: "unreachable" }
  | { kind: "stopped"; by: string }
  | { kind: "speaking" }
  | { kind: "driving"; place: string | null }
  | { kind: "turning" }
  | { kind: "moving" }
  | { kind: "charging" }
  | { kind: "ready" };

/** m/s up to which the robot counts as standing. */
const STANDING = 0.02;

export function robotState(
  telemetry: Telemetry | null,
  link: LinkState,
  health: Health | null,
  silentSince: number | null,
  stoppedBy: string | null,
): RobotState {
  // Checked before the stop: somebody may have released it, and this page would not know.
  if (silentSince !== null || isCutOff(link)) return { kind: "unreachable" };
  if (stoppedBy !== null) return { kind: "stopped", by: stoppedBy };
  if (health?.robot.up === false) return { kind: "unreachable" };
  if (link.status !== "online" || telemetry === null) return { kind: "unknown" };
  if (!telemetry.online) return { kind: "unreachable" };
  if (telemetry.motion !== null) {
    if (telemetry.motion.kind === "rotate") return { kind: "turning" };
    return { kind: "driving", place: telemetry.motion.place };
  }
  if (telemetry.speaking !== null) return { kind: "speaking" };
  if (Math.abs(telemetry.linear ?? 0) > STANDING) return { kind: "moving" };
  return telemetry.charging ? { kind: "charging" } : { kind: "ready" };
}
