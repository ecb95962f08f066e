/** What the list of sessions says of each, what a search finds, and how a fresh first page meets the older ones. Pure. */
import type { SessionInfo } from "@agentclientprotocol/sdk";
import { asString, turnOf } from "../wire/meta";
import type { Role } from "../api/http";
import type { Conversation } from "./conversation/conversation";

/** Whose session it is; null when the agent does not say. */
export function ownerOf(session: SessionInfo): string | null {
  return asString(session._meta?.["robot-acp/owner"]);
}

/** Whether a turn runs in it. What is watched is known at every moment; the list is as old as its last reading. */
export function worksIn(
  session: SessionInfo,
  watched: Conversation | undefined,
  holder: string | null,
): boolean {
  if (holder === session.sessionId) return true;
  return watched === undefined ? turnOf(session._meta)?.state === "running" : watched.turn !== null;
}

/** Whether this person may remove it: an own session, or anyone's for a supervisor. */
export function mayDelete(session: SessionInfo, me: { name: string; role: Role }): boolean {
  const owner = ownerOf(session);
  return owner === null || owner === me.name || me.role === "supervisor";
}

export const wordsOf = (search: string): string[] => search.toLocaleLowerCase().split(/\s+/).filter(Boolean);

/** As the agent searches: each word is in the title or in the owner's name. */
export function matches(session: SessionInfo, search: string): boolean {
  const places = [session.title ?? "", ownerOf(session) ?? ""].map((text) => text.toLocaleLowerCase());
  return wordsOf(search).every((word) => places.some((text) => text.includes(word)));
}

/** A first page that was read again, with the older sessions that had been read below it. */
export function refreshed(known: readonly SessionInfo[], page: readonly SessionInfo[]): SessionInfo[] {
  const ids = new Set(page.map(({ sessionId }) => sessionId));
  const last = page.at(-1);
  if (last === undefined) return [];
  const older = known.filter((session) => !ids.has(session.sessionId) && timeOf(session) < timeOf(last));
  return [...page, ...older];
}

function timeOf(session: SessionInfo): number {
  return Date.parse(session.updatedAt ?? "") || 0;
}
