/** What the robot is doing, for components, which render again only when that changes. */
import { useShallow } from "zustand/react/shallow";
import { robotState, type RobotState } from "../state/robot-state";
import { useStore } from "../state/store";

export function useRobotState(): RobotState {
  return useStore(
    useShallow(({ telemetry, link, health, silentSince, stop }) =>
      robotState(telemetry, link, health, silentSince, stop?.by ?? null),
    ),
  );
}
