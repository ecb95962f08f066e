/** How long to wait before the next attempt to connect. Pure: chance is passed in. */

export const FIRST_MS = 500;
export const LONGEST_MS = 5000;

/** Doubles from 0.5 s to 5 s; a fifth of it is left to chance, so that many pages do not come back at once. */
export function backoff(attempt: number, random: number): number {
  const base = Math.min(LONGEST_MS, FIRST_MS * 2 ** attempt);
  return Math.round(Math.min(LONGEST_MS, Math.max(FIRST_MS, base * (0.8 + 0.4 * random))));
}
