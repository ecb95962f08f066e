/**
 * Notices that nobody is there any more: warns some time before the end, so that whoever is can stay, and ends. Begins
 * again after each end. While something runs it does not count: a visitor who walks with the robot touches nothing.
 */

export interface IdleTimerEvents {
  /** `at` is when it will be over, in ms of this machine's clock; null: somebody touched, or it is over. */
  onWarn: (at: number | null) => void;
  onOver: () => void;
}

export class IdleTimer {
  private timer: ReturnType<typeof setTimeout> | undefined;
  private held = false;

  constructor(
    private readonly limitMs: number,
    private readonly warningMs: number,
    private readonly events: IdleTimerEvents,
  ) {
    this.touch();
  }

  /** Somebody is there. */
  touch(): void {
    clearTimeout(this.timer);
    this.events.onWarn(null);
    if (this.held) return;
    this.timer = setTimeout(() => this.warn(), this.limitMs - this.warningMs);
  }

  /** While `held`, the time does not count; after it, all of it does. */
  hold(held: boolean): void {
    if (held === this.held) return;
    this.held = held;
    this.touch();
  }

  end(): void {
    clearTimeout(this.timer);
  }

  private warn(): void {
    this.events.onWarn(Date.now() + this.warningMs);
    this.timer = setTimeout(() => {
      this.touch();
      this.events.onOver();
    }, this.warningMs);
  }
}
