/** What the address of a kiosk says: `/kiosk?lang=es&rest=90&voice=on&map=off`. A value that makes no sense counts as none. */

const REST_S = 60;
const SHORTEST_S = 20;
const LONGEST_S = 600;

export interface KioskSettings {
  /** ms without a touch after which it starts over. */
  idleMs: number;
  /** Whether the microphone may be used: the browser may send what it hears to its maker. */
  voice: boolean;
  map: boolean;
}

export function kioskSettings(query: string): KioskSettings {
  const given = new URLSearchParams(query);
  const rest = Number(given.get("rest") ?? "");
  const seconds = rest > 0 ? Math.min(LONGEST_S, Math.max(SHORTEST_S, rest)) : REST_S;
  return { idleMs: seconds * 1000, voice: given.get("voice") === "on", map: given.get("map") !== "off" };
}
