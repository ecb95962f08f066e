/**
 * The log of one session while somebody looks at it: read from the agent, then kept up with what comes. A number that is
 * missing, as that of one's own prompt, which the agent does not send back, is asked for; so there is never a gap.
 */
import type { Event } from "./event-feed";
import { NoLog, type Page } from "./event-pages";
import { MOST, rowOf, type Row, type Titles } from "../../state/log-rows";

/** `behind`: the connection was lost; it goes on with `catchUp`. */
export type Standing = "reading" | "ready" | "behind" | "none";

export interface Snapshot {
  /** Oldest first. The same array until something has changed. */
  rows: readonly Row[];
  standing: Standing;
}

/** Many events in a moment are shown at once. */
const TELL_MS = 100;
const BUNDLE = 1000;

export class EventLog {
  private rows: Row[] = [];
  private readonly titles: Titles = new Map();
  /** The number of the last event in here, and of the last one that is known to exist. */
  private last = 0;
  private wanted = 0;
  private standing: Standing = "reading";
  private reading = false;
  private snapshot: Snapshot = { rows: [], standing: "reading" };
  private timer: ReturnType<typeof setTimeout> | null = null;
  private readonly watchers = new Set<() => void>();

  constructor(private readonly read: (after: number) => Promise<Page>) {}

  readonly get = (): Snapshot => this.snapshot;

  readonly watch = (watcher: () => void): (() => void) => {
    this.watchers.add(watcher);
    return () => this.watchers.delete(watcher);
  };

  /** Takes in an event that has just come. */
  take(event: Event): void {
    this.wanted = Math.max(this.wanted, event.seq);
    if (this.reading || event.seq <= this.last) return;
    if (event.seq === this.last + 1 && this.standing === "ready") this.add([event]);
    else void this.catchUp();
  }

  /** Reads what is missing. Never rejects. */
  async catchUp(): Promise<void> {
    if (this.reading || this.standing === "none") return;
    this.reading = true;
    try {
      do {
        const { events, last } = await this.read(this.last);
        this.wanted = Math.max(this.wanted, last);
        this.add(events);
        if (events.length === 0) break;
      } while (this.last < this.wanted);
      this.standing = "ready";
    } catch (error) {
      this.standing = error instanceof NoLog ? "none" : "behind";
    } finally {
      this.reading = false;
      this.tell();
    }
  }

  private add(events: readonly Event[]): void {
    for (const event of events) {
      if (event.seq <= this.last) continue;
      this.rows.push(rowOf(event, this.titles));
      this.last = event.seq;
    }
    // In bundles: who reads an older page must not have it move with each event.
    const over = Math.ceil((this.rows.length - MOST) / BUNDLE);
    if (over > 0) this.rows.splice(0, over * BUNDLE);
    this.tell();
  }

  private tell(): void {
    this.timer ??= setTimeout(() => {
      this.timer = null;
      this.snapshot = { rows: [...this.rows], standing: this.standing };
      for (const watcher of this.watchers) watcher();
    }, TELL_MS);
  }
}
