/** How long to wait before the next attempt to connect. Pure: the random number is a parameter. */

export const FIRST_MS = 500;
export const LONGEST_MS = 5000;

/**
 * The pause before attempt number `attempt`, in ms: it doubles from 0.5 s to 5 s. `random`, from 0 to 1, varies it by
 * a fifth, so that many pages do not come back in the same moment.
 */
export function backoff(attempt: number, random: number): number {
  const base = Math.min(LONGEST_MS, FIRST_MS * 2 ** attempt);
  return Math.round(Math.min(LONGEST_MS, Math.max(FIRST_MS, base * (0.8 + 0.4 * random))));
}
