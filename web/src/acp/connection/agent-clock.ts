/** What time it is at the agent, by which events are dated: this machine's clock may be another one. */
import { getState } from "../../state/store";

/** The agent's clock less this one's, in s, from the last event that came live; null before the first. */
let offset: number | null = null;

/** An event that was recorded at `at` has just come. */
export function hear(at: number | null): void {
  if (at !== null) offset = at - Date.now() / 1000;
}

/** Unix seconds. */
export function agentNow(): number {
  return Date.now() / 1000 + (offset ?? getState().clockOffsetMs / 1000);
}
