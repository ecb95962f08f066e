/** The numbered events of sessions, handed on as they come to whoever looks at them one by one. Keeps none. */
import type { SessionNotification, SessionUpdate } from "@agentclientprotocol/sdk";
import { atOf, seqOf } from "../../wire/meta";

export interface Event {
  seq: number;
  /** Unix seconds by the agent's clock. */
  at: number;
  update: SessionUpdate;
}

type Listener = (sessionId: string, event: Event) => void;

const listeners = new Set<Listener>();

/** Returns what ends it. */
export function listen(listener: Listener): () => void {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

export function tell({ sessionId, update, _meta }: SessionNotification): void {
  const [seq, at] = [seqOf(_meta), atOf(_meta)];
  if (listeners.size === 0 || seq === null || at === null) return;
  for (const listener of listeners) listener(sessionId, { seq, at, update });
}
