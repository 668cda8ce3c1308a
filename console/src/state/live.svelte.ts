// What the server shows: link, table, frames, events, batches of plots; live or of a recording. Views say what they want
// to see while they are there, and read it here.
import { host } from "../host";
import { get } from "../http";
import { joined } from "../marks";
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
import { said } from "./words.svelte";

const MOST_EVENTS = 300;
const MOST_MARKS = 20_000;
const LOOK_EVERY = 200; // ms between two steps of the ages
const ALWAYS: Wish = { link: true, events: true, marks: true, plots: [], source: "live" };

class Live {
  isOpen = $state(false);
  /** Whether the page receives the server's news. False: it shows the past. */
  isHeard = $state(false);
  /** Seconds since anything came from the server, in steps; null: nothing ever did. */
  silence = $state<number | null>(null);
  /** Seconds since the newest report about the link: a server that reads a large recording sends none in that time. */
  age = $state(0);
  why = $state("");
  hasToken = $state(true); // false: the server refused it
  link = $state.raw<LinkView | null>(null);
  /** The same while it has a port. */
  readonly served = $derived(this.link?.connected ? this.link : null);
  /** Whether the emergency stop is latched, by the last report. Kept while the server is not heard. */
  stopped = $state(false);
  rows = $state.raw<Row[]>([]);
  rowsAt = $state(0); // the server's time of `rows`
  entries = $state.raw<Entry[]>([]);
  events = $state.raw<LinkEvent[]>([]);
  /** What is marked on a line of time; of a recording all of it, wherever the reader is. */
  marks = $state.raw<LinkEvent[]>([]);
  /** The newest message of each view that no other member keeps: see `shown` of shown.svelte.ts. */
  newest = $state.raw<Record<string, unknown>>({});
  recording = $state.raw<{ name: string; from: number; to: number; problems: string[] } | null>(null);
  protocol = $state.raw<Protocol | null>(null); // of the link
  private recorded = $state.raw<{ name: string; protocol: Protocol | null }>({ name: "", protocol: null });
  /** Of the shown data: a recording has its own. */
  readonly shown = $derived(this.recorded.name ? this.recorded.protocol : this.protocol);
  problem = $state(""); // of the request
  private wish: Wish = { ...ALWAYS };
  private readonly shownBy = new Map<string, { wish: unknown }[]>(); // the wishes of each component that shows a view
  private isDue = false;
  private protocolHash: string | null = null;
  private readonly onBatch = new Set<(batch: Batch) => void>();
  private wallAhead = $state(0); // of the server's clock: its seconds since 1970 less its seconds of `t`
  private readonly clock = { server: 0, page: 0 };
  private heardAt = -Infinity;
  private linkAt = -Infinity;
  private readonly views = new Views(
    () => host.now.socket("views"),
    () => place.token,
    {
      open: (isOpen, why) => this.setOpen(isOpen, why),
      heard: () => (this.heardAt = performance.now()),
      silent: (isSilent) => {
        this.isHeard = !isSilent;
        this.look();
      },
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
    setInterval(() => this.look(), LOOK_EVERY);
  }

  /** The server's time now, as well as this page knows it. */
  now(): number {
    return this.clock.server === 0 ? 0 : this.clock.server + (performance.now() - this.clock.page) / 1000;
  }

  /** A time of the shown data, as text: of day; in a recording seconds since its start. */
  timeText(t: number, digits = 3): string {
    return this.recorded.name ? `${t.toFixed(digits)} s` : this.clockText(t, digits);
  }

  /** The same on an axis, whose values need no unit each. */
  tickText(t: number, digits: number): string {
    return this.recorded.name ? t.toFixed(digits) : this.clockText(t, digits);
  }

  /** The time of day of something live, whatever is shown beside it. */
  clockText(t: number, digits = 3): string {
    return clockText(t + this.wallAhead, Math.min(3, digits));
  }

  /** Changes the wish; it is sent once, together with other changes of this turn of the loop. */
  want(part: Partial<Wish>): void {
    this.wish = { ...this.wish, ...part };
    if (this.isDue) return;
    this.isDue = true;
    queueMicrotask(() => {
      this.isDue = false;
      this.views.want(this.wish);
    });
  }

  /** Asks for a view until the returned function is called. Of several that ask, the last one's wish counts. */
  show(view: string, wish: unknown): () => void {
    const before = this.shownBy.get(view) ?? [];
    const mine = { wish }; // an object of its own, distinct from an equal one
    this.showTo(view, [...before, mine]);
    return () =>
      this.showTo(
        view,
        (this.shownBy.get(view) ?? []).filter((one) => one !== mine),
      );
  }

  private showTo(view: string, wishes: { wish: unknown }[]): void {
    this.shownBy.set(view, wishes);
    this.want({ [view]: wishes.at(-1)?.wish ?? null });
    if (wishes.length === 0 && view in this.newest) {
      this.newest = Object.fromEntries(Object.entries(this.newest).filter(([name]) => name !== view));
    }
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
    if (name !== this.recorded.name) {
      this.events = this.marks = this.rows = []; // they are of the data shown before
      this.newest = {};
    }
    this.recording = null;
    this.problem = "";
    this.recorded = { name, protocol: null };
    this.want({ source: name ? { recording: name } : "live" });
    if (!name) return;
    try {
      const protocol = await get<Protocol>(`api/protocol?recording=${encodeURIComponent(name)}`);
      if (this.recorded.name === name) this.recorded = { name, protocol };
    } catch (error) {
      if (this.recorded.name === name) this.problem = error instanceof Error ? error.message : String(error);
    }
  }

  private look(): void {
    const now = performance.now();
    this.silence = this.heardAt === -Infinity ? null : (now - this.heardAt) / 1000;
    this.age = this.link === null ? 0 : (now - this.linkAt) / 1000;
  }

  private setOpen(isOpen: boolean, why: string): void {
    this.isOpen = this.isHeard = isOpen;
    this.look();
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
        this.linkAt = performance.now();
        this.stopped = this.link.stopped ?? false;
        this.age = 0;
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
      case "marks": {
        const news = message.marks as LinkEvent[];
        this.marks = message.replace ? news : joined(this.marks, news).slice(-MOST_MARKS);
        return;
      }
      case "recording":
        this.recording = message as unknown as NonNullable<Live["recording"]>;
        return;
      case "error":
        if (message.error === "token") this.hasToken = false;
        this.problem = said(message, "text");
        return;
      default:
        this.newest = { ...this.newest, [view]: message };
    }
  }
}
export const live = new Live();
