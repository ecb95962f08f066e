/** The destination of "Go here", and the prompt that asks for it. Nothing here sends the prompt. */
import type { PickedPoint } from "../wire/scene";

/** A place by its name, or a point in m in the map frame. */
export type Destination = { place: string } | { x: number; y: number };

export function destinationOf({ x, y, place }: PickedPoint): Destination {
  return place === null ? { x, y } : { place };
}

/** English whatever the page's language is: every model understands it, and the built-in commands know it best. */
export function promptFor(destination: Destination): string {
  if ("place" in destination) return `Go to ${destination.place}`;
  return `Go to the point x ${metres(destination.x)}, y ${metres(destination.y)}`;
}

/** To 0.1 m, which is finer than a finger; never "-0.0". */
function metres(value: number): string {
  return (Math.round(value * 10) / 10 + 0).toFixed(1);
}
