/** The agent's own log of a session, read page by page. Nothing here is kept, and nobody is attached by it. */
import { RequestError } from "@agentclientprotocol/sdk";
import type { Event } from "./event-feed";
import { asNumber, isRecord } from "../../wire/meta";
import { theAgent } from "../sessions/sessions";

const METHOD_NOT_FOUND = -32601;

export interface Page {
  events: Event[];
  /** The number of the session's last event. */
  last: number;
}

/** This agent has no log that it shows. */
export class NoLog extends Error {}

/** The events after number `after`, in order. Throws `NoLog`, and what a lost connection throws. */
export async function readEvents(sessionId: string, after: number, limit?: number): Promise<Page> {
  const agent = theAgent();
  if (agent === null) throw new Error("there is no connection");
  try {
    return parsePage(await agent.request("_robot/events", { sessionId, after, ...(limit && { limit }) }));
  } catch (error) {
    if (error instanceof RequestError && error.code === METHOD_NOT_FOUND) throw new NoLog();
    throw error;
  }
}

function parsePage(answer: unknown): Page {
  const told = isRecord(answer) ? answer : {};
  const events = Array.isArray(told["events"]) ? told["events"].filter(isEvent) : [];
  return { events, last: asNumber(told["last"]) ?? events.at(-1)?.seq ?? 0 };
}

function isEvent(value: unknown): value is Event {
  return (
    isRecord(value) &&
    asNumber(value["seq"]) !== null &&
    asNumber(value["at"]) !== null &&
    isRecord(value["update"])
  );
}

/** All events of a session as JSON Lines, one event a line. */
export async function asLines(sessionId: string): Promise<Blob> {
  const parts: string[] = [];
  let after = 0;
  for (;;) {
    const { events, last } = await readEvents(sessionId, after);
    parts.push(...events.map(({ seq, at, update }) => `${JSON.stringify({ seq, at, update })}\n`));
    after = events.at(-1)?.seq ?? last;
    if (after >= last) return new Blob(parts, { type: "application/jsonl" });
  }
}
