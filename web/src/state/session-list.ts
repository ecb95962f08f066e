/** The list of sessions: what it says of each, what a search finds, and how its first page is read again. Pure. */
import type { SessionInfo } from "@agentclientprotocol/sdk";
import { ownerOf, turnOf } from "../wire/meta";
import type { Conversation } from "./conversation/conversation";
import type { Role } from "../wire/bridge";

/**
 * Whether a turn runs in the session. A conversation that this page watches is up to date; the list is as old as its last
 * reading. `holder` is the session that controls the robot.
 */
export function isWorking(
  session: SessionInfo,
  watched: Conversation | undefined,
  holder: string | null,
): boolean {
  if (holder === session.sessionId) return true;
  return watched === undefined ? turnOf(session._meta)?.state === "running" : watched.turn !== null;
}

/** Whether this person may delete the session: everybody their own, a supervisor any. */
export function mayDelete(session: SessionInfo, me: { name: string; role: Role }): boolean {
  const owner = ownerOf(session._meta);
  return owner === null || owner === me.name || me.role === "supervisor";
}

export const searchWords = (search: string): string[] =>
  search.toLocaleLowerCase().split(/\s+/).filter(Boolean);

/** As the agent searches: each word is in the title or in the owner's name. */
export function matchesSearch(session: SessionInfo, search: string): boolean {
  const places = [session.title ?? "", ownerOf(session._meta) ?? ""].map((text) => text.toLocaleLowerCase());
  return searchWords(search).every((word) => places.some((text) => text.includes(word)));
}

/** The first page, which has just been read again, with the older sessions that had been loaded below it. */
export function mergeFirstPage(known: readonly SessionInfo[], page: readonly SessionInfo[]): SessionInfo[] {
  const ids = new Set(page.map(({ sessionId }) => sessionId));
  const last = page.at(-1);
  if (last === undefined) return [];
  const older = known.filter((session) => !ids.has(session.sessionId) && timeOf(session) < timeOf(last));
  return [...page, ...older];
}

function timeOf(session: SessionInfo): number {
  return Date.parse(session.updatedAt ?? "") || 0;
}
