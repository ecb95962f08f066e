/** The messages of `WS /scene/<viewer>/control`: where a viewer's camera stands, and the point that was picked on the map. */
import { asNumber, asString, isRecord } from "./fields";

/** The views that a viewer can ask for. */
export const VIEWS = ["follow", "top", "map"] as const;
export type View = (typeof VIEWS)[number];
/** "free": the viewer has moved the camera by hand. */
export type ShownView = View | "free";

/** A point of the floor, in m in the map frame; `place` is the name of the place there, if one is. */
export interface PickedPoint {
  x: number;
  y: number;
  place: string | null;
}

export type SceneMessage = { view: ShownView } | { picked: PickedPoint } | { error: string };

/** Null for a message of no known kind. */
export function parseSceneMessage(data: unknown): SceneMessage | null {
  const message = typeof data === "string" ? parseJson(data) : null;
  if (!isRecord(message)) return null;
  const { view, picked, error } = message;
  if (view === "free" || VIEWS.some((known) => known === view)) return { view: view as ShownView };
  if (typeof error === "string") return { error };
  if (!isRecord(picked)) return null;
  const [x, y] = [asNumber(picked["x"]), asNumber(picked["y"])];
  return x === null || y === null ? null : { picked: { x, y, place: asString(picked["place"]) } };
}

function parseJson(text: string): unknown {
  try {
    return JSON.parse(text);
  } catch {
    return null;
  }
}
