/**
 * The log of one session while it is on the screen: read from the agent, then kept up with the events that come live. The
 * agent does not send a prompt back to the one who sent it, so numbers can be missing among the live events; the log then
 * reads them from the agent, and never has a gap.
 */
import { MAX_ROWS, rowOf, type Row, type Titles } from "../../state/log-rows";
import type { EventPage, NumberedEvent } from "../../wire/event";
import { LogUnavailable } from "./event-pages";

/** `behind`: the connection was lost; `catchUp` continues. `unavailable`: the agent has no log to read. */
export type LogStatus = "reading" | "ready" | "behind" | "unavailable";

export interface Snapshot {
  /** Oldest first. The same array until something has changed. */
  rows: readonly Row[];
  status: LogStatus;
}

/** Events that come within this time are shown at once. */
const PUBLISH_MS = 100;
/** Old rows leave in bundles: somebody who reads an older page must not see it move with each event. */
const BUNDLE = 1000;

export class EventLog {
  private rows: Row[] = [];
  private readonly titles: Titles = new Map();
  /** The number of the last event in `rows`. */
  private lastSeq = 0;
  /** The number of the last event that is known to exist. */
  private newestSeq = 0;
  private status: LogStatus = "reading";
  /** True while `catchUp` reads. */
  private reading = false;
  private snapshot: Snapshot = { rows: [], status: "reading" };
  /** Set while a snapshot is due. */
  private timer: ReturnType<typeof setTimeout> | null = null;
  private readonly subscribers = new Set<() => void>();

  constructor(private readonly readAfter: (seq: number) => Promise<EventPage>) {}

  readonly getSnapshot = (): Snapshot => this.snapshot;

  readonly subscribe = (subscriber: () => void): (() => void) => {
    this.subscribers.add(subscriber);
    return () => this.subscribers.delete(subscriber);
  };

  /** Takes in an event that has just come. */
  receive(event: NumberedEvent): void {
    this.newestSeq = Math.max(this.newestSeq, event.seq);
    if (this.reading || event.seq <= this.lastSeq) return;
    if (event.seq === this.lastSeq + 1 && this.status === "ready") this.add([event]);
    else void this.catchUp();
  }

  /** Reads what is missing. Never rejects. */
  async catchUp(): Promise<void> {
    if (this.reading || this.status === "unavailable") return;
    this.reading = true;
    try {
      do {
        const { events, last } = await this.readAfter(this.lastSeq);
        this.newestSeq = Math.max(this.newestSeq, last);
        this.add(events);
        if (events.length === 0) break;
      } while (this.lastSeq < this.newestSeq);
      this.status = "ready";
    } catch (error) {
      this.status = error instanceof LogUnavailable ? "unavailable" : "behind";
    } finally {
      this.reading = false;
      this.publish();
    }
  }

  private add(events: readonly NumberedEvent[]): void {
    for (const event of events) {
      if (event.seq <= this.lastSeq) continue;
      this.rows.push(rowOf(event, this.titles));
      this.lastSeq = event.seq;
    }
    const bundles = Math.ceil((this.rows.length - MAX_ROWS) / BUNDLE);
    if (bundles > 0) this.rows.splice(0, bundles * BUNDLE);
    this.publish();
  }

  private publish(): void {
    this.timer ??= setTimeout(() => {
      this.timer = null;
      this.snapshot = { rows: [...this.rows], status: this.status };
      for (const subscriber of this.subscribers) subscriber();
    }, PUBLISH_MS);
  }
}
