/**
 * Shows one picture of a stream at a time: while the browser decodes one, only the newest that comes waits. Every object
 * URL that is created is revoked.
 */
export class LatestPicture {
  private waiting: Blob | null = null;
  /** The URL of the picture that the browser decodes. */
  private decoding: string | null = null;
  /** The URL of the picture on the screen. */
  private shown: string | null = null;

  /** `show` receives the URL of the next picture, or null for none. */
  constructor(private readonly show: (url: string | null) => void) {}

  receive(jpeg: Blob): void {
    if (this.decoding !== null) {
      this.waiting = jpeg;
      return;
    }
    this.decoding = URL.createObjectURL(jpeg);
    this.show(this.decoding);
  }

  /** To be called when the browser has decoded the picture, or could not. */
  decoded(): void {
    if (this.decoding === null) return;
    if (this.shown !== null) URL.revokeObjectURL(this.shown);
    this.shown = this.decoding;
    this.decoding = null;
    const next = this.waiting;
    this.waiting = null;
    if (next !== null) this.receive(next);
  }

  clear(): void {
    for (const url of [this.decoding, this.shown]) if (url !== null) URL.revokeObjectURL(url);
    this.decoding = this.shown = this.waiting = null;
    this.show(null);
  }
}
