/** The numbered events of a session, as they come live and as the agent's log gives them page by page. */
import type { SessionNotification, SessionUpdate } from "@agentclientprotocol/sdk";
import { asNumber, isRecord } from "./fields";
import { atOf, seqOf } from "./meta";

export interface NumberedEvent {
  seq: number;
  /** Unix seconds by the agent's clock. */
  at: number;
  update: SessionUpdate;
}

export interface EventPage {
  events: NumberedEvent[];
  /** The number of the session's last event. */
  last: number;
}

/** Null for an update without number or time: the log cannot order it. */
export function parseLiveEvent({ update, _meta }: SessionNotification): NumberedEvent | null {
  const [seq, at] = [seqOf(_meta), atOf(_meta)];
  return seq === null || at === null ? null : { seq, at, update };
}

export function parseEventPage(answer: unknown): EventPage {
  const page = isRecord(answer) ? answer : {};
  const events = Array.isArray(page["events"]) ? page["events"].filter(isNumberedEvent) : [];
  return { events, last: asNumber(page["last"]) ?? events.at(-1)?.seq ?? 0 };
}

function isNumberedEvent(value: unknown): value is NumberedEvent {
  return (
    isRecord(value) &&
    asNumber(value["seq"]) !== null &&
    asNumber(value["at"]) !== null &&
    isRecord(value["update"])
  );
}
