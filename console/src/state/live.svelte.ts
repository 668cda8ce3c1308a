// What the server shows: link, table, frames, events, batches of plots; live or of a recording. Views say what they want
// to see while they are there, and read it here.
import { address, get } from "../http";
import { clockText, type Protocol } from "../protocol";
import {
  Views,
  type Batch,
  type Entry,
  type LinkEvent,
  type LinkView,
  type PlotWish,
  type Row,
  type Wish,
} from "../views";
import { place } from "./place.svelte";

const MOST_EVENTS = 300;
const NONE: Wish = { link: true, messages: null, frames: null, events: true, plots: [], source: "live" };

class Live {
  isOpen = $state(false);
  why = $state("");
  hasToken = $state(true); // false: the server refused it
  link = $state.raw<LinkView | null>(null);
  rows = $state.raw<Row[]>([]);
  rowsAt = $state(0); // the server's time of `rows`
  entries = $state.raw<Entry[]>([]);
  events = $state.raw<LinkEvent[]>([]);
  recording = $state.raw<{ name: string; from: number; to: number; problems: string[] } | null>(null);
  protocol = $state.raw<Protocol | null>(null); // of the link
  private recorded = $state.raw<{ name: string; protocol: Protocol | null }>({ name: "", protocol: null });
  /** Of what is shown: a recording has its own. */
  readonly shown = $derived(this.recorded.name ? this.recorded.protocol : this.protocol);
  problem = $state(""); // of what was asked for
  private wish: Wish = { ...NONE };
  private isDue = false;
  private protocolHash: string | null = null;
  private readonly onBatch = new Set<(batch: Batch) => void>();
  private wallAhead = $state(0); // of the server's clock: its seconds since 1970 less its seconds of `t`
  private readonly clock = { server: 0, page: 0 };
  private readonly views = new Views(
    address("views", "ws"),
    () => place.token,
    {
      open: (isOpen, why) => this.setOpen(isOpen, why),
      text: (view, message) => this.take(view, message),
      batch: (batch) => {
        this.note(batch.now);
        for (const callback of this.onBatch) callback(batch);
      },
    },
    this.wish,
  );

  start(): void {
    this.views.connect();
  }

  /** The server's time now, as well as this page knows it. */
  now(): number {
    return this.clock.server === 0 ? 0 : this.clock.server + (performance.now() - this.clock.page) / 1000;
  }

  /** A time of what is shown, in words: of day; in a recording seconds since its start. */
  timeText(t: number, digits = 3): string {
    return this.recording === null ? clockText(t + this.wallAhead, Math.min(3, digits)) : t.toFixed(digits);
  }

  /** Is the newest that was shown older than it should be? Then nothing on the page is the present. */
  isFresh(): boolean {
    return this.isOpen && performance.now() - this.clock.page < 1500;
  }

  /** Changes what is wanted; goes out once, after what else this turn of the loop wants. */
  want(part: Partial<Wish>): void {
    this.wish = { ...this.wish, ...part };
    if (this.isDue) return;
    this.isDue = true;
    queueMicrotask(() => {
      this.isDue = false;
      this.views.want(this.wish);
    });
  }

  wantPlots(plots: PlotWish[]): void {
    this.want({ plots });
  }

  batches(callback: (batch: Batch) => void): () => void {
    this.onBatch.add(callback);
    return () => this.onBatch.delete(callback);
  }

  async loadProtocol(): Promise<void> {
    try {
      this.protocol = await get<Protocol>("api/protocol");
      this.protocolHash = this.protocol.hash;
    } catch {
      this.protocol = null;
    }
  }

  /** Shows this recording in place of the link; empty: the link again. */
  async showRecording(name: string): Promise<void> {
    if (name !== this.recorded.name) this.events = this.rows = []; // they are of what was shown before
    this.recording = null;
    this.problem = "";
    this.recorded = { name, protocol: null };
    this.want(name ? { source: { recording: name }, at: undefined } : { source: "live", at: undefined });
    if (!name) return;
    try {
      const protocol = await get<Protocol>(`api/protocol?recording=${encodeURIComponent(name)}`);
      if (this.recorded.name === name) this.recorded = { name, protocol };
    } catch (error) {
      if (this.recorded.name === name) this.problem = error instanceof Error ? error.message : String(error);
    }
  }

  private setOpen(isOpen: boolean, why: string): void {
    this.isOpen = isOpen;
    this.why = why;
    if (isOpen) {
      this.hasToken = true;
      void this.loadProtocol();
    } else {
      this.link = null;
    }
  }

  private note(t: unknown): void {
    if (typeof t !== "number") return;
    this.clock.server = t;
    this.clock.page = performance.now();
  }

  /** Sparklines come less often than the rows that they belong to. */
  private merged(rows: Row[]): Row[] {
    const before = new Map(this.rows.map((row) => [`${row.sender}:${row.name}`, row]));
    return rows.map((row) => ({ ...row, spark: row.spark ?? before.get(`${row.sender}:${row.name}`)?.spark ?? null }));
  }

  private take(view: string, message: Record<string, unknown>): void {
    switch (view) {
      case "link":
        this.link = message as unknown as LinkView;
        this.note(message.t);
        this.wallAhead = (message.wall as number) - (message.t as number);
        if (this.link.connected && this.link.hash !== this.protocolHash) {
          this.protocolHash = this.link.hash;
          void this.loadProtocol();
        }
        return;
      case "messages":
        this.rows = this.merged(message.rows as Row[]);
        this.rowsAt = message.t as number;
        return;
      case "frames":
        this.entries = message.entries as Entry[];
        return;
      case "events": {
        const news = message.events as LinkEvent[];
        this.events = message.replace ? news : [...this.events, ...news].slice(-MOST_EVENTS);
        return;
      }
      case "recording":
        this.recording = message as unknown as NonNullable<Live["recording"]>;
        return;
      case "error":
        if (message.error === "token") this.hasToken = false;
        this.problem = (message.text as string) ?? "";
    }
  }
}
export const live = new Live();
