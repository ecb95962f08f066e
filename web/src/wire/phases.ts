/** The phases of a turn, by the names that the agent gives them (docs/extensions.md). */

/** In the order in which tables list them. */
export const PHASES = [
  "thought",
  "inference",
  "navigation",
  "speech",
  "person",
  "waiting",
  "tools",
  "protocols",
] as const;

export type Phase = (typeof PHASES)[number];

/** Seconds by phase, and in all. */
export type Seconds = Record<Phase | "total", number>;
