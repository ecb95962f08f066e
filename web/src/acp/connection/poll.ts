/**
 * Asks again and again, and never twice at a time: the next request begins only after the one before has ended. What a
 * request answers after `now` or `end` counts for nothing; `ask` learns that from its signal.
 */

/** Between the end of a request and the next one, in ms, however long it took. */
const SHORTEST_PAUSE_MS = 1000;

export class Poll {
  /** Belongs to the request that is under way or came last; null before the first one and after `end`. */
  private current: AbortController | null = null;
  private underWay = false;
  private timer: ReturnType<typeof setTimeout> | undefined;

  /** `everyMs`: from the beginning of one request to the next. A request that rejects counts as ended. */
  constructor(
    private readonly ask: (signal: AbortSignal) => Promise<void>,
    private readonly everyMs: number,
  ) {}

  /** Asks at once; a request that is under way is given up. */
  now(): void {
    this.end();
    const current = new AbortController();
    this.current = current;
    this.underWay = true;
    const begun = performance.now();
    void this.ask(current.signal)
      .catch(() => undefined)
      .then(() => {
        if (this.current !== current) return;
        this.underWay = false;
        const pause = Math.max(SHORTEST_PAUSE_MS, this.everyMs - (performance.now() - begun));
        this.timer = setTimeout(() => this.now(), pause);
      });
  }

  /** Begins to ask; does nothing where it has begun. */
  start(): void {
    if (this.current === null) this.now();
  }

  /** Asks at once, unless a request is under way. */
  soon(): void {
    if (!this.underWay) this.now();
  }

  end(): void {
    clearTimeout(this.timer);
    this.current?.abort();
    this.current = null;
    this.underWay = false;
  }
}
