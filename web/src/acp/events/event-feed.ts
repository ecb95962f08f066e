/** Hands the numbered events of sessions on, as they come, to whoever subscribes. Keeps none. */
import type { SessionNotification } from "@agentclientprotocol/sdk";
import { parseLiveEvent, type NumberedEvent } from "../../wire/event";

type Subscriber = (sessionId: string, event: NumberedEvent) => void;

const subscribers = new Set<Subscriber>();

/** Returns a function that ends the subscription. */
export function subscribeToEvents(subscriber: Subscriber): () => void {
  subscribers.add(subscriber);
  return () => subscribers.delete(subscriber);
}

/** An update without number or time is not published. */
export function publish(notification: SessionNotification): void {
  if (subscribers.size === 0) return;
  const event = parseLiveEvent(notification);
  if (event === null) return;
  for (const subscriber of subscribers) subscriber(notification.sessionId, event);
}
