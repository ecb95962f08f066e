/**
 * The page's side of `WS /scene/<viewer>/control`: where this viewer's camera stands, and what it picks on the map.
 * The view that somebody chose is kept over lost connections. Nothing in here can make the robot do anything.
 */
import { asNumber, asString, isRecord } from "../wire/meta";
import { KeptSocket } from "./reconnecting-socket";

export const VIEWS = ["follow", "top", "map"] as const;
export type View = (typeof VIEWS)[number];
/** "free": the viewer has moved the camera. */
export type ShownView = View | "free";

/** A point of the floor, in m in the map frame; with a name where a place is. */
export interface Picked {
  x: number;
  y: number;
  place: string | null;
}

export type Told = { view: ShownView } | { picked: Picked } | { error: string };

export interface SceneEvents {
  /** Null while nobody knows. */
  onView: (view: ShownView | null) => void;
  onPicked: (picked: Picked) => void;
  onRefused: (sentence: string) => void;
}

/** Null for what is none of the messages that there are. */
export function parseTold(data: unknown): Told | null {
  const told = typeof data === "string" ? json(data) : null;
  if (!isRecord(told)) return null;
  const { view, picked, error } = told;
  if (view === "free" || VIEWS.some((known) => known === view)) return { view: view as ShownView };
  if (typeof error === "string") return { error };
  if (!isRecord(picked)) return null;
  const [x, y] = [asNumber(picked["x"]), asNumber(picked["y"])];
  return x === null || y === null ? null : { picked: { x, y, place: asString(picked["place"]) } };
}

function json(text: string): unknown {
  try {
    return JSON.parse(text);
  } catch {
    return null;
  }
}

export class SceneLink {
  private readonly socket: KeptSocket;
  /** What was chosen last, until the viewer moves the camera. */
  private wanted: View | null = null;
  private picking = false;
  /** Whether this connection has said where the camera stands; it does so before it has read what we want. */
  private greeted = false;

  constructor(
    viewer: string,
    private readonly events: SceneEvents,
  ) {
    this.socket = new KeptSocket(`/scene/${viewer}/control`, {
      onOpen: () => this.opened(),
      onMessage: (data) => this.take(parseTold(data)),
      onLost: () => events.onView(null),
    });
  }

  end(): void {
    this.socket.end();
  }

  drop(): void {
    this.socket.drop();
  }

  show(view: View): void {
    this.wanted = view;
    this.socket.send({ view });
  }

  pick(on: boolean): void {
    this.picking = on;
    this.socket.send({ pick: on });
  }

  private opened(): void {
    this.greeted = false;
    if (this.wanted !== null) this.socket.send({ view: this.wanted });
    if (this.picking) this.socket.send({ pick: true });
  }

  private take(told: Told | null): void {
    if (told === null) return;
    if ("picked" in told) {
      if (this.picking) this.events.onPicked(told.picked);
    } else if ("error" in told) {
      this.events.onRefused(told.error);
    } else {
      if (this.greeted) this.wanted = told.view === "free" ? null : told.view;
      this.greeted = true;
      this.events.onView(told.view);
    }
  }
}

/** A name for this page that no other one has. `crypto.randomUUID` is missing where the page comes over plain HTTP. */
export function newViewer(): string {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  bytes[6] = ((bytes[6] ?? 0) & 0x0f) | 0x40; // version 4: random
  bytes[8] = ((bytes[8] ?? 0) & 0x3f) | 0x80;
  const hex = Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
  return hex.replace(/^(.{8})(.{4})(.{4})(.{4})(.{12})$/, "$1-$2-$3-$4-$5");
}
