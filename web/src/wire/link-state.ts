/** How the page's ACP connection stands. */
export type LinkState =
  /** `first` until one attempt has succeeded: the page has just been opened. */
  | { status: "connecting"; first: boolean }
  | { status: "online" }
  /** `retryAt`: when the next attempt begins, in ms of this machine's clock. */
  | { status: "waiting"; retryAt: number }
  | { status: "off" };

/** Whether a connection that was expected is missing. A page that is opening for the first time has lost nothing yet. */
export function isCutOff(link: LinkState): boolean {
  return link.status === "waiting" || (link.status === "connecting" && !link.first);
}
