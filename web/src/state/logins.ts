/** What the list of logins shows, in which order, and which names are taken. */
import type { IssuedLogin } from "../wire/logins";

export interface SortedLogins {
  /** By name, the newest of a name first; the one that this page uses at the top. */
  valid: IssuedLogin[];
  /** Expired and revoked ones, the newest first. */
  ended: IssuedLogin[];
}

export function sortLogins(logins: readonly IssuedLogin[]): SortedLogins {
  const valid = logins.filter(({ state }) => state === "valid");
  const ended = logins.filter(({ state }) => state !== "valid");
  return {
    valid: valid.sort(
      (one, other) =>
        Number(other.own) - Number(one.own) ||
        one.name.localeCompare(other.name) ||
        other.created - one.created,
    ),
    ended: ended.sort((one, other) => other.created - one.created),
  };
}

/** The newest login of somebody with this name, whom a new login with it would be mistaken for; null for a new name. */
export function namesake(logins: readonly IssuedLogin[], name: string): IssuedLogin | null {
  const wanted = plain(name);
  const alike = logins.filter((login) => plain(login.name) === wanted);
  return alike.find(({ state }) => state === "valid") ?? alike.at(-1) ?? null;
}

/** Two names that are the same here are one person's for the bridge. */
function plain(name: string): string {
  return name.normalize("NFKC").toLowerCase().trim().split(/\s+/).join(" ");
}

/** The address that logs in whoever opens it. The token is behind the #, which no browser sends to a server. */
export function loginAddress(origin: string, token: string): string {
  return `${origin}/#token=${token}`;
}
