/** Reads the agent's own log of a session, page by page. Keeps nothing, and watches no session. */
import { RequestError } from "@agentclientprotocol/sdk";
import { parseEventPage, type EventPage } from "../../wire/event";
import { METHODS } from "../../wire/methods";
import { getAgent } from "../connection/agent";

/** JSON-RPC 2.0, section 5.1. */
const METHOD_NOT_FOUND = -32601;

/** This agent gives no access to its log. */
export class LogUnavailable extends Error {}

/**
 * The events after number `after`, in order, at most `limit` of them.
 * Throws `LogUnavailable`, and the connection's own error when that is lost.
 */
export async function readEvents(sessionId: string, after: number, limit?: number): Promise<EventPage> {
  const agent = getAgent();
  if (agent === null) throw new Error("there is no connection");
  try {
    return parseEventPage(await agent.request(METHODS.events, { sessionId, after, ...(limit && { limit }) }));
  } catch (error) {
    if (error instanceof RequestError && error.code === METHOD_NOT_FOUND) throw new LogUnavailable();
    throw error;
  }
}

/** All events of a session as JSON Lines, one event a line. Throws what `readEvents` throws. */
export async function exportEvents(sessionId: string): Promise<Blob> {
  const parts: string[] = [];
  let after = 0;
  for (;;) {
    const { events, last } = await readEvents(sessionId, after);
    parts.push(...events.map(({ seq, at, update }) => `${JSON.stringify({ seq, at, update })}\n`));
    after = events.at(-1)?.seq ?? last;
    if (after >= last) return new Blob(parts, { type: "application/jsonl" });
  }
}
