/**
 * A WebSocket beside ACP that is kept up: opened again with growing pauses until somebody ends it. What its messages
 * mean is not decided here, and nothing that is sent while it is away is kept.
 */
import { backoff } from "../wire/backoff";

export interface SocketEvents {
  onOpen?: () => void;
  onMessage: (data: unknown) => void;
  /** It is gone or never came to be; another attempt follows. */
  onLost?: () => void;
}

export class KeptSocket {
  /** Null between attempts, and for good once it has been ended. */
  private socket: WebSocket | null = null;
  private again: ReturnType<typeof setTimeout> | undefined;
  private attempt = 0;

  constructor(
    private readonly path: string,
    private readonly events: SocketEvents,
  ) {
    this.open();
  }

  end(): void {
    clearTimeout(this.again);
    const { socket } = this;
    this.socket = null;
    socket?.close();
  }

  /** Give up a connection that seems dead; the next attempt follows. */
  drop(): void {
    const { socket } = this;
    if (socket === null) return;
    socket.close(); // its closing can take a minute when nobody is there
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
    const current = (): boolean => this.socket === socket;
    socket.onopen = () => {
      if (current()) this.events.onOpen?.();
    };
    socket.onmessage = ({ data }: MessageEvent<unknown>) => {
      if (!current()) return;
      this.attempt = 0; // only now: a server that lets in and throws out at once must not be pestered
      this.events.onMessage(data);
    };
    socket.onclose = () => {
      if (current()) this.lost();
    };
  }

  private lost(): void {
    this.socket = null;
    this.again = setTimeout(() => this.open(), backoff(this.attempt++, Math.random()));
    this.events.onLost?.();
  }
}
