/** The time by the agent's clock, which dates the events: this machine's clock may be wrong. */
import { getState } from "../../state/store";

/** The agent's clock minus this machine's, in s, from the last live event; null before the first. */
let offset: number | null = null;

/** Takes the time of an event that has just come: `at` in Unix seconds by the agent's clock. */
export function syncClock(at: number | null): void {
  if (at !== null) offset = at - Date.now() / 1000;
}

/** Unix seconds. Before the first event the bridge's clock has to do. */
export function agentNow(): number {
  return Date.now() / 1000 + (offset ?? getState().clockOffsetMs / 1000);
}
