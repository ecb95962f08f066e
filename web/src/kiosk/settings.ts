/** The settings in the address of a kiosk: `/kiosk?lang=es&rest=90&voice=on&map=off`. A value that makes no sense is ignored. */

/** The time without a touch, in s, after which the screen starts over. */
const DEFAULT_S = 60;
const SHORTEST_S = 20;
const LONGEST_S = 600;

export interface KioskSettings {
  /** ms without a touch after which the screen starts over. */
  idleMs: number;
  /** Whether the microphone may be used. The browser may send the recording to its maker's server. */
  voice: boolean;
  map: boolean;
}

export function kioskSettings(query: string): KioskSettings {
  const given = new URLSearchParams(query);
  const rest = Number(given.get("rest") ?? "");
  const seconds = rest > 0 ? Math.min(LONGEST_S, Math.max(SHORTEST_S, rest)) : DEFAULT_S;
  return { idleMs: seconds * 1000, voice: given.get("voice") === "on", map: given.get("map") !== "off" };
}
