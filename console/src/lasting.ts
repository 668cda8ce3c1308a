// A WebSocket that comes back by itself, and notices when nothing comes through it. A network that fails closes nothing:
// the browser would call the connection open for minutes. The server says something at least 4 times a second.

export const SILENT_AFTER = 1000; // ms without a message: the page says that it receives nothing
export const DROPPED_AFTER = 3000; // ms without one, or without an end of connecting: another connection is tried
const LOOK_EVERY = 100; // ms
const FIRST_WAIT = 250; // ms before the next attempt
const LONGEST_WAIT = 2000;

export type Socket = Pick<WebSocket, "send" | "close" | "readyState"> & {
  onopen: ((event: never) => void) | null;
  onmessage: ((event: never) => void) | null;
  onclose: ((event: never) => void) | null;
};
export interface LastingListener {
  /** A new connection: it expects the first message. */
  opened(): void;
  message(data: unknown): void;
  /** Nothing has come for `SILENT_AFTER`, or something comes again, on the same connection. */
  silent(isSilent: boolean): void;
  /** The connection has ended, or is given up. The next is tried by itself. */
  lost(reason: string): void;
}

export class LastingSocket {
  private socket: Socket | null = null;
  private isOpen = false;
  private isSilent = false;
  private heardAt = -Infinity; // on this connection: its begin, or its newest message
  private wait = FIRST_WAIT;
  private again: ReturnType<typeof setTimeout> | null = null;
  private look: ReturnType<typeof setInterval> | null = null;
  private ended = false;

  constructor(
    private readonly make: () => Socket,
    private readonly listener: LastingListener,
    private readonly now: () => number,
  ) {}

  connect(): void {
    if (this.ended) return;
    this.look ??= setInterval(() => this.watch(), LOOK_EVERY);
    const socket = this.make();
    this.socket = socket;
    this.isOpen = this.isSilent = false;
    this.heardAt = this.now();
    socket.onopen = () => {
      if (socket !== this.socket) return;
      this.isOpen = true;
      this.listener.opened();
    };
    socket.onmessage = (event: never) => {
      if (socket !== this.socket) return;
      this.heardAt = this.now();
      if (this.isSilent) {
        this.isSilent = false;
        this.listener.silent(false);
      }
      this.listener.message((event as MessageEvent).data);
    };
    socket.onclose = (event: never) => {
      if (socket === this.socket) this.lost((event as CloseEvent).reason ?? "");
    };
  }

  say(message: Record<string, unknown>): void {
    if (this.socket?.readyState === 1) this.socket.send(JSON.stringify(message));
  }

  /** The server has taken this connection: the next loss is retried soon. */
  isGood(): void {
    this.wait = FIRST_WAIT;
  }

  /** Tries no more. The connection that is open stays. */
  stay(): void {
    this.ended = true;
  }

  end(): void {
    this.ended = true;
    if (this.again) clearTimeout(this.again);
    this.unwatch();
    const socket = this.socket;
    this.socket = null;
    socket?.close();
  }

  private watch(): void {
    if (!this.socket) return;
    const age = this.now() - this.heardAt;
    if (age > DROPPED_AFTER) {
      const socket = this.socket;
      this.socket = null; // the end of a close would take as long as the network is away
      socket.close();
      this.lost("");
    } else if (age > SILENT_AFTER && this.isOpen && !this.isSilent) {
      this.isSilent = true;
      this.listener.silent(true);
    }
  }

  private lost(reason: string): void {
    this.socket = null;
    this.listener.lost(reason);
    if (this.ended) {
      this.unwatch();
      return;
    }
    this.again = setTimeout(() => this.connect(), this.wait);
    this.wait = Math.min(this.wait * 2, LONGEST_WAIT);
  }

  private unwatch(): void {
    if (this.look) clearInterval(this.look);
    this.look = null;
  }
}
