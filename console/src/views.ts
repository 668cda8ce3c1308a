// The `/views` socket of docs/console-api.md: what the page shows. It says what it wants to see, whole each time, and takes
// what comes. A lost connection comes back by itself, with the same wish.
import { LastingSocket, type Socket } from "./lasting";

export interface Account {
  bytes: number;
  frames: number;
  messages: Record<string, number>;
  discarded?: Record<string, number>;
  [key: string]: unknown;
}
export interface Rate {
  per_second: number;
  due: number | null;
  missing?: unknown;
}
export interface LinkView {
  t: number;
  wall: number;
  connected: boolean;
  connecting?: { port: string; why: string } | null;
  state: "up" | "stale" | "down";
  why: string;
  heard: number | null;
  protocol: string;
  hash: string;
  port: string;
  baud: number;
  line: Record<string, unknown> | null;
  holder: string | null;
  clients: number;
  stopped: boolean;
  /** The name of the program whose emergency stop holds. */
  stopped_by: string | null;
  struck: unknown[];
  mcu_deadlines: { deadline: number; since: number | null; unknown: boolean }[];
  rates: {
    seconds: number;
    receive: Record<string, number>;
    send: Record<string, number>;
    messages: Record<string, Rate>;
    sent: Record<string, Rate>;
    baud: number;
    bits_per_byte: number;
  };
  receive: Record<string, unknown>;
  send: Record<string, unknown>;
  late: number;
  held_back: number;
  reconnects: number;
  collisions: number;
  peer: { state: string; why: string };
  /** Seconds, but for the drift: parts per million. */
  clock: { offset: number; drift: number; error: number; round_trip: number; exchanges: number } | null;
  round_trip: { count: number; p50: number; p95: number; p99: number; max: number } | null;
  recording: { name: string; seconds: number | null; size: number } | null;
  history: { bytes: number; most: number; from: number; lost: number };
}
export interface Row {
  name: string;
  sender: "host" | "mcu";
  count: number;
  t: number | null;
  rate: number | null;
  due: number | null;
  fields: Record<string, unknown> | null;
  header?: Record<string, unknown>;
  violations?: unknown[];
  bytes: string | null;
  spark?: { field: string; values: (number | null)[] } | null;
}
export interface Entry {
  n: number;
  t: number;
  direction: "received" | "sent";
  bytes: string;
  kind: "frame" | "discarded" | "fill";
  message?: string;
  fields?: Record<string, unknown>;
  header?: Record<string, unknown>;
  violations?: unknown[];
  size?: number;
}
export interface LinkEvent {
  t: number;
  kind: string;
  text: string;
  [key: string]: unknown;
}
export interface PlotWish {
  id: string;
  fields: string[];
  seconds?: number;
  from?: number;
  to?: number;
  pixels: number;
}
export interface Wish {
  /** By view: what the page wants of it. */
  [view: string]: unknown;
  plots: PlotWish[];
  source: "live" | { recording: string };
  at?: number;
}
export interface Column {
  field: string;
  t: Float64Array;
  low: Float32Array | Float64Array;
  high: Float32Array | Float64Array;
}
export interface Batch {
  plot: string;
  now: number;
  from: number;
  to: number;
  width: number; // seconds of one pixel
  replace: boolean;
  columns: Column[];
}
export interface ViewsListener {
  /** The connection is there, or is lost. */
  open(isOpen: boolean, why: string): void;
  /** Something came: the server's beat, 4 times a second at least, or a view. */
  heard(): void;
  /** The connection is open, and nothing comes through it; or something comes again. */
  silent(isSilent: boolean): void;
  text(view: string, message: Record<string, unknown>): void;
  batch(batch: Batch): void;
}

const ARRAYS = { f32: Float32Array, f64: Float64Array } as const;

/** A binary message of one plot. The arrays are in the message's own memory. */
export function readBatch(data: ArrayBuffer): Batch {
  const size = new DataView(data).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, size))) as Omit<Batch, "columns"> & {
    columns: { field: string; n: number; t: "f64"; low: "f32" | "f64"; high: "f32" | "f64" }[];
  };
  let at = Math.ceil((4 + size) / 8) * 8;
  const array = (kind: "f32" | "f64", n: number) => {
    const values = new ARRAYS[kind](data, at, n);
    at += Math.ceil(values.byteLength / 8) * 8;
    return values;
  };
  const columns = head.columns.map((column) => ({
    field: column.field,
    t: array(column.t, column.n) as Float64Array,
    low: array(column.low, column.n),
    high: array(column.high, column.n),
  }));
  return { ...head, columns };
}

export class Views {
  private readonly socket: LastingSocket;

  constructor(
    make: () => Socket,
    private readonly token: () => string,
    private readonly listener: ViewsListener,
    private wish: Wish,
  ) {
    const on = {
      opened: () => this.socket.say({ token: this.token(), acks: true, views: this.wish }),
      message: (data: unknown) => this.take(data),
      silent: (isSilent: boolean) => this.listener.silent(isSilent),
      lost: (reason: string) => this.listener.open(false, reason),
    };
    this.socket = new LastingSocket(make, on, () => performance.now());
  }

  connect(): void {
    this.socket.connect();
  }

  /** Changes the wish. The same wish again sends nothing. */
  want(wish: Wish): void {
    const isSame = JSON.stringify(wish) === JSON.stringify(this.wish);
    this.wish = wish;
    if (!isSame) this.socket.say({ acks: true, views: wish });
  }

  private take(data: unknown): void {
    this.listener.heard();
    if (data instanceof ArrayBuffer) {
      this.listener.batch(readBatch(data));
      return;
    }
    const message = JSON.parse(data as string) as Record<string, unknown>;
    switch (message.view) {
      case "hello":
        this.socket.isGood();
        this.listener.open(true, "");
        break;
      case "beat":
        return;
      case "end":
        // The server goes on when this round is drawn, so that nothing that is shown has waited in a buffer.
        requestAnimationFrame(() => this.socket.say({ seen: message.round }));
        return;
    }
    if (message.error === "token") this.socket.stay();
    this.listener.text((message.view as string) ?? "error", message);
  }
}
