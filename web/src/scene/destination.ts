/** Where "Go here" would send the robot, and the words that ask for it. Nothing here sends them. */
import type { Picked } from "./scene-link";

export type Destination = { place: string } | { x: number; y: number };

export function destinationOf({ x, y, place }: Picked): Destination {
  return place === null ? { x, y } : { place };
}

/** English whatever the page's language is: of another language the built-in commands know little, and every model knows it. */
export function promptFor(destination: Destination): string {
  if ("place" in destination) return `Go to ${destination.place}`;
  return `Go to the point x ${metres(destination.x)}, y ${metres(destination.y)}`;
}

/** To 0.1 m, which is finer than a finger; never "-0.0". */
function metres(value: number): string {
  return (Math.round(value * 10) / 10 + 0).toFixed(1);
}
