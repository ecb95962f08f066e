/** Whether this browser's dashboard shows the camera beside the map, remembered from one visit to the next. */

const KEPT = "robot-acp/camera";

/** Null while nobody has chosen. */
export function keptCamera(): boolean | null {
  try {
    const kept = window.localStorage.getItem(KEPT);
    return kept === null ? null : kept === "open";
  } catch {
    return null; // a browser may forbid it; then the screen's size decides
  }
}

export function keepCamera(open: boolean): void {
  try {
    window.localStorage.setItem(KEPT, open ? "open" : "closed");
  } catch {
    // See above.
  }
}
