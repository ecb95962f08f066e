/** Whether this browser's dashboard shows the camera beside the map, remembered from one visit to the next. */
import { readStored, STORAGE, writeStored } from "../browser-storage";

/** Null while nobody has chosen. */
export function storedCameraChoice(): boolean | null {
  const stored = readStored(STORAGE.camera);
  return stored === null ? null : stored === "open";
}

export function storeCameraChoice(open: boolean): void {
  writeStored(STORAGE.camera, open ? "open" : "closed");
}
