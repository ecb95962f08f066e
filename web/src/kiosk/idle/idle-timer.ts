/**
 * Notices that nobody uses the kiosk any more: warns some time before the end, so that a person who is still there can
 * stay, then ends and starts over. While it is paused no time passes: a visitor who walks with the robot touches nothing.
 */

export interface IdleTimerEvents {
  /** `endsAt`: when the time will be up, in ms of this machine's clock; null withdraws the warning. */
  onWarn: (endsAt: number | null) => void;
  onEnd: () => void;
}

export class IdleTimer {
  private timer: ReturnType<typeof setTimeout> | undefined;
  private paused = false;

  constructor(
    private readonly limitMs: number,
    private readonly warningMs: number,
    private readonly events: IdleTimerEvents,
  ) {
    this.restart();
  }

  /** Somebody is there: the whole time begins again. */
  restart(): void {
    clearTimeout(this.timer);
    this.events.onWarn(null);
    if (this.paused) return;
    this.timer = setTimeout(() => this.warn(), this.limitMs - this.warningMs);
  }

  /** After a pause the whole time begins again. */
  setPaused(paused: boolean): void {
    if (paused === this.paused) return;
    this.paused = paused;
    this.restart();
  }

  /** Stops the timer for good. */
  dispose(): void {
    clearTimeout(this.timer);
  }

  private warn(): void {
    this.events.onWarn(Date.now() + this.warningMs);
    this.timer = setTimeout(() => {
      this.restart();
      this.events.onEnd();
    }, this.warningMs);
  }
}
