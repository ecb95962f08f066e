/**
 * The page's side of `WS /scene/<viewer>/control`: where this viewer's camera stands, and what is picked on the map.
 * The view that somebody chose survives a lost connection. Nothing here can make the robot do anything.
 */
import {
  parseSceneMessage,
  type PickedPoint,
  type SceneMessage,
  type ShownView,
  type View,
} from "../wire/scene";
import { ReconnectingSocket } from "./reconnecting-socket";

export interface SceneEvents {
  /** Null while the scene is not connected. */
  onView: (view: ShownView | null) => void;
  onPicked: (picked: PickedPoint) => void;
  onRefused: (sentence: string) => void;
}

export class SceneLink {
  private readonly socket: ReconnectingSocket;
  /** The view that was chosen last; null once the camera was moved by hand. */
  private chosenView: View | null = null;
  private picking = false;
  /** Whether this connection has reported its first view, which it sends before it has read the chosen one. */
  private firstViewReported = false;

  constructor(
    viewer: string,
    private readonly events: SceneEvents,
  ) {
    this.socket = new ReconnectingSocket(`/scene/${viewer}/control`, {
      onOpen: () => this.opened(),
      onMessage: (data) => this.receive(parseSceneMessage(data)),
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
    this.chosenView = view;
    this.socket.send({ view });
  }

  pick(on: boolean): void {
    this.picking = on;
    this.socket.send({ pick: on });
  }

  private opened(): void {
    this.firstViewReported = false;
    if (this.chosenView !== null) this.socket.send({ view: this.chosenView });
    if (this.picking) this.socket.send({ pick: true });
  }

  private receive(message: SceneMessage | null): void {
    if (message === null) return;
    if ("picked" in message) {
      if (this.picking) this.events.onPicked(message.picked);
    } else if ("error" in message) {
      this.events.onRefused(message.error);
    } else {
      if (this.firstViewReported) this.chosenView = message.view === "free" ? null : message.view;
      this.firstViewReported = true;
      this.events.onView(message.view);
    }
  }
}

/** A UUID (RFC 9562, version 4) for this page. `crypto.randomUUID` is missing where the page comes over plain HTTP. */
export function newViewerId(): string {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  bytes[6] = ((bytes[6] ?? 0) & 0x0f) | 0x40; // version 4: random
  bytes[8] = ((bytes[8] ?? 0) & 0x3f) | 0x80;
  const hex = Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
  return hex.replace(/^(.{8})(.{4})(.{4})(.{4})(.{12})$/, "$1-$2-$3-$4-$5");
}
