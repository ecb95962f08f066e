/** The logins that were issued, as the bridge lists them. */
import { parseRole, type Role } from "./bridge";
import { asNumber, asRecords, asString, isRecord } from "./fields";

const STATES = ["valid", "expired", "revoked"] as const;
export type LoginState = (typeof STATES)[number];

/** A login that somebody was given; the list never has its token. */
export interface IssuedLogin {
  id: string;
  name: string;
  role: Role;
  /** Unix seconds. */
  created: number;
  expires: number;
  state: LoginState;
  /** Whether it is the one with which this page is logged in. */
  own: boolean;
}

/** A login that was just made. The token is in no other answer. */
export interface NewLogin {
  token: string;
  name: string;
  role: Role;
  /** Unix seconds. */
  expires: number;
}

/** Null where the answer is no such list. A login that cannot be read is left out. */
export function parseLogins(body: unknown): IssuedLogin[] | null {
  if (!isRecord(body) || !Array.isArray(body["tokens"])) return null;
  return asRecords(body["tokens"]).flatMap((entry) => {
    const id = asString(entry["id"]);
    const role = parseRole(entry["role"]);
    const [created, expires] = [asNumber(entry["created"]), asNumber(entry["expires"])];
    const state = STATES.find((known) => known === entry["state"]);
    if (id === null || role === null || created === null || expires === null || state === undefined)
      return [];
    return [
      { id, name: asString(entry["name"]) ?? "", role, created, expires, state, own: entry["own"] === true },
    ];
  });
}

export function parseNewLogin(body: unknown): NewLogin | null {
  if (!isRecord(body)) return null;
  const [token, role, expires] = [
    asString(body["token"]),
    parseRole(body["role"]),
    asNumber(body["expires"]),
  ];
  if (token === null || role === null || expires === null) return null;
  return { token, name: asString(body["name"]) ?? "", role, expires };
}
