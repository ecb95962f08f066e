/**
 * One picture at a time out of a stream: while the browser decodes one, only the newest that comes waits. Every URL that
 * was made is given back.
 */
export class LatestPicture {
  private waiting: Blob | null = null;
  /** Given to the browser, which has not decoded it yet. */
  private loading: string | null = null;
  /** On the screen. */
  private shown: string | null = null;

  /** `show` is told the URL of the next picture, or null for none. */
  constructor(private readonly show: (url: string | null) => void) {}

  take(jpeg: Blob): void {
    if (this.loading !== null) {
      this.waiting = jpeg;
      return;
    }
    this.loading = URL.createObjectURL(jpeg);
    this.show(this.loading);
  }

  /** The browser shows what it was given, or could not. */
  settled(): void {
    if (this.loading === null) return;
    if (this.shown !== null) URL.revokeObjectURL(this.shown);
    this.shown = this.loading;
    this.loading = null;
    const next = this.waiting;
    this.waiting = null;
    if (next !== null) this.take(next);
  }

  clear(): void {
    for (const url of [this.loading, this.shown]) if (url !== null) URL.revokeObjectURL(url);
    this.loading = this.shown = this.waiting = null;
    this.show(null);
  }
}
