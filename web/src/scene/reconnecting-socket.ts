/**
 * A WebSocket beside ACP that is opened again with growing pauses until somebody ends it. What its messages mean is not
 * decided here, and what is sent while it is closed is dropped.
 */
import { backoff } from "../wire/backoff";

/** A browser opens one WebSocket at a time to a server: one that never opens must not keep the others waiting. */
const OPENS_WITHIN_MS = 10_000;

export interface SocketEvents {
  onOpen?: () => void;
  onMessage: (data: unknown) => void;
  /** The socket closed or never opened; another attempt follows. */
  onLost?: () => void;
}

export class ReconnectingSocket {
  /** Null between attempts, and for good once it has been ended. */
  private socket: WebSocket | null = null;
  private retryTimer: ReturnType<typeof setTimeout> | undefined;
  private attempt = 0;

  constructor(
    private readonly path: string,
    private readonly events: SocketEvents,
  ) {
    this.open();
  }

  end(): void {
    clearTimeout(this.retryTimer);
    const { socket } = this;
    this.socket = null;
    socket?.close();
  }

  /** Gives up a connection that seems dead; the next attempt follows. */
  drop(): void {
    const { socket } = this;
    if (socket === null) return;
    socket.close(); // closing can take a minute when the other end does not answer
    this.lost();
  }

  send(message: unknown): void {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  private open(): void {
    const url = new URL(this.path, window.location.href);
    url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(url);
    this.socket = socket;
    const isCurrent = (): boolean => this.socket === socket;
    const limit = setTimeout(() => {
      if (isCurrent()) this.drop();
    }, OPENS_WITHIN_MS);
    socket.onopen = () => {
      clearTimeout(limit);
      if (isCurrent()) this.events.onOpen?.();
    };
    socket.onmessage = ({ data }: MessageEvent<unknown>) => {
      if (!isCurrent()) return;
      this.attempt = 0; // not at `onopen`: a server that accepts and closes at once must not be pestered
      this.events.onMessage(data);
    };
    socket.onclose = () => {
      clearTimeout(limit);
      if (isCurrent()) this.lost();
    };
  }

  private lost(): void {
    this.socket = null;
    this.retryTimer = setTimeout(() => this.open(), backoff(this.attempt++, Math.random()));
    this.events.onLost?.();
  }
}
