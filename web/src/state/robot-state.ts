/** What the robot is doing, in one word of a fixed list: computed from all that is known, never stored. */
import type { Telemetry } from "../wire/telemetry";
import type { Health } from "../api/http";
import type { LinkState } from "../acp/connection/link";

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

export function robotState(
  telemetry: Telemetry | null,
  link: LinkState,
  health: Health | null,
  heardUntil: number | null,
  stoppedBy: string | null,
): RobotState {
  // Before the stop: somebody may have released it, and nobody here would know.
  if (heardUntil !== null || link.status === "waiting" || (link.status === "connecting" && !link.first))
    return { kind: "unreachable" };
  if (stoppedBy !== null) return { kind: "stopped", by: stoppedBy };
  if (health?.robot.up === false) return { kind: "unreachable" };
  if (link.status !== "online" || telemetry === null) return { kind: "unknown" };
  if (!telemetry.online) return { kind: "unreachable" };
  if (telemetry.motion !== null) {
    if (telemetry.motion.kind === "rotate") return { kind: "turning" };
    return { kind: "driving", place: telemetry.motion.place };
  }
  if (telemetry.speaking !== null) return { kind: "speaking" };
  if (Math.abs(telemetry.linear ?? 0) > 0.02) return { kind: "moving" };
  return telemetry.charging ? { kind: "charging" } : { kind: "ready" };
}
