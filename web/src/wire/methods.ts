/** The ACP methods that robot-acp adds, by the names of docs/extensions.md. Each name is written here and nowhere else. */
export const METHODS = {
  abilities: "_robot/abilities",
  events: "_robot/events",
  leave: "_robot/leave",
  people: "_robot/people",
  takeOver: "_robot/take_over",
  telemetry: "_robot/telemetry",
} as const;
