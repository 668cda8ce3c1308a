// The views of docs/console-api.md for one page: each round sends only news of the wanted views.
import type { LinkView, PlotWish, Wish } from "../views";
import type { Clock } from "./clock";
import { HOST, senderName, type Sender } from "./engine";
import { PlotFeed } from "./plotfeed";
import { hex, told, type Source } from "./source";

const ROUND_EVERY = 1 / 30; // seconds
const BEAT_EVERY = 0.25; // seconds: a page that hears nothing for longer knows that this worker stalls
const LINK_EVERY = 0.5;
const FRAMES_EVERY = 0.1;
const SPARKS_EVERY = 0.5;
const SPARK_SECONDS = 20;
const SPARK_POINTS = 40;
const LEAST_WINDOW = 2; // seconds in which a rate is counted
const SHORTEST_WINDOW = 0.25; // of a message that has just begun to come
const WINDOW_INTERVALS = 5;
const MOST_UNSEEN = 2; // rounds under way to a page that says which it has drawn
const VERSION = 1;

/** A recording that is shown in the place of the link. */
export interface Replay {
  name: string;
  source: Source;
  duration: number;
  problems: string[];
}
/** What the rounds show. */
export interface Scene {
  /** The live link's; null: there is none. */
  source: Source | null;
  link(): LinkView | Record<string, unknown>;
  /** What a person wants to know at once when it changes. */
  short(): string;
  /** Opens a recording. Throws an `Error` with a sentence. */
  open(name: string): Promise<Replay>;
}
interface Said {
  views?: Wish;
  acks?: boolean;
  seen?: number;
}
type Out = string | ArrayBuffer;

export class Rounds {
  private wish: Wish = { plots: [], source: "live" };
  private feeds = new Map<string, PlotFeed>();
  private replay: Replay | null = null;
  private of: Source | null = null;
  private errors: Record<string, unknown>[] = [];
  private isKnown = false; // the page has sent its wish
  private acks = false;
  private rounds = 0;
  private seen = 0;
  private isAtOnce = false;
  private roundAt = -Infinity;
  private saidAt = -Infinity;
  // last sent state of each view
  private nextAt: Record<string, number> = {};
  private last: Record<string, unknown> = {};

  constructor(
    private readonly clock: Clock,
    private readonly scene: () => Scene,
    private readonly say: (message: Out) => void,
  ) {}

  /** One message of the page. */
  take(message: Said): void {
    if (message.acks !== undefined) this.acks = message.acks;
    if (message.seen !== undefined) this.seen = Math.min(Math.max(message.seen, this.seen), this.rounds);
    if (message.views) this.want(message.views);
    if (!this.isKnown) {
      this.isKnown = true;
      const link = this.scene().source?.facts.protocol.name ?? null;
      const [t, wall] = [this.clock.now(), Date.now() / 1000];
      this.tell({ view: "hello", version: VERSION, t, wall, link });
    }
  }

  /** Call it 50 times a second. */
  look(): void {
    if (!this.isKnown) return;
    const now = this.clock.now();
    const isDue = this.isAtOnce || now - this.roundAt >= ROUND_EVERY;
    if (isDue && !(this.acks && this.rounds - this.seen >= MOST_UNSEEN)) {
      this.roundAt = now;
      this.isAtOnce = false;
      const out = this.round(now);
      for (const one of out) this.post(one);
      if (out.length > 0 && this.acks) this.tell({ view: "end", round: ++this.rounds });
    }
    if (now - this.saidAt >= BEAT_EVERY) this.tell({ view: "beat", t: now });
  }

  private post(out: Out): void {
    this.saidAt = this.clock.now();
    this.say(out);
  }

  private tell(value: Record<string, unknown>): void {
    this.post(JSON.stringify(value));
  }

  private want(wish: Wish): void {
    const before = this.wish;
    this.wish = wish;
    this.isAtOnce = true;
    const isSame = (one: unknown, other: unknown) => JSON.stringify(one) === JSON.stringify(other);
    if (!isSame(before.source, wish.source)) this.choose(wish.source);
    for (const view of ["link", "messages", "frames", "events", "marks"]) {
      if (!isSame(before[view], wish[view]) || (before.at !== wish.at && view !== "link" && view !== "marks")) {
        this.forget(view);
      }
    }
    const feeds = this.feeds;
    this.feeds = new Map();
    const plots = new Map(before.plots.map((plot) => [plot.id, plot]));
    for (const plot of wish.plots) {
      const known = isSame(plots.get(plot.id), plot) ? feeds.get(plot.id) : undefined;
      this.feeds.set(plot.id, known ?? this.feed(plot));
    }
  }

  private forget(view: string): void {
    delete this.nextAt[view];
    delete this.last[view];
  }

  private choose(source: Wish["source"]): void {
    this.replay = null;
    if (source === "live") return;
    const name = source.recording;
    const isStillWanted = () => this.wish.source !== "live" && this.wish.source.recording === name;
    this.scene()
      .open(name)
      .then((replay) => {
        if (!isStillWanted()) return;
        this.replay = replay;
        this.tell({ view: "recording", name, from: 0, to: replay.duration, problems: replay.problems });
      })
      .catch((error: Error) => {
        if (isStillWanted()) this.errors.push({ view: "error", error: "recording", text: error.message });
      });
  }

  private get source(): Source | null {
    if (this.wish.source !== "live") return this.replay?.source ?? null;
    return this.scene().source;
  }

  /** Of the fields that there are; the others are named. */
  private feed(plot: PlotWish): PlotFeed {
    const source = this.source;
    const fields = plot.fields.filter((field) => {
      if (!source) return false;
      try {
        source.history.find(field);
        return true;
      } catch (error) {
        this.errors.push({ view: "error", error: "field", text: (error as Error).message });
        return false;
      }
    });
    return new PlotFeed({ ...plot, fields });
  }

  private round(now: number): Out[] {
    const out: Out[] = [];
    const source = this.source;
    if (source !== this.of) {
      this.of = source;
      this.feeds = new Map(this.wish.plots.map((plot) => [plot.id, this.feed(plot)]));
      this.nextAt = {};
      this.last = {};
    }
    for (const error of this.errors) out.push(JSON.stringify(error));
    this.errors = [];
    const at = this.replay ? (this.wish.at ?? this.replay.duration) : null;
    const shown = at ?? now;
    const add = (view: string, what: Record<string, unknown> | null) => {
      if (what) out.push(JSON.stringify({ view, ...what }));
    };
    if (this.wish.link) add("link", this.link(now));
    if (!source) return out;
    if (this.wish.messages) add("messages", this.messages(source, now, shown, at));
    if (this.wish.frames) add("frames", this.frames(source, now, shown, at));
    if (this.wish.events) add("events", this.events(source, at));
    if (this.wish.marks) add("marks", this.marks(source));
    for (const feed of this.feeds.values()) {
      const batch = feed.batch(source.history, now);
      if (batch) out.push(batch);
    }
    return out;
  }

  private isDue(view: string, now: number, every: number): boolean {
    if (now < (this.nextAt[view] ?? -Infinity)) return false;
    this.nextAt[view] = now + every;
    return true;
  }

  private link(now: number): Record<string, unknown> | null {
    const short = this.scene().short();
    if (!this.isDue("link", now, LINK_EVERY) && short === this.last.link) return null;
    this.last.link = short;
    this.nextAt.link = now + LINK_EVERY;
    return this.scene().link() as Record<string, unknown>;
  }

  private messages(source: Source, now: number, shown: number, at: number | null): Record<string, unknown> | null {
    const { every = 0.1 } = this.wish.messages as { every?: number };
    if (!this.isDue("messages", now, every)) return null;
    const withSparks = this.isDue("sparks", now, SPARKS_EVERY);
    const rows = source.history.tracks.map((track) =>
      this.row(source, track.sender, track.name, shown, at, withSparks),
    );
    const marks = JSON.stringify(rows.map((row) => [row.t, row.count, (row.rate as number).toFixed(1)]));
    if (marks === this.last.messages && (at !== null || !withSparks)) return null;
    this.last.messages = marks;
    return { t: shown, rows };
  }

  private row(
    source: Source,
    sender: Sender,
    name: string,
    now: number,
    at: number | null,
    withSpark: boolean,
  ): Record<string, unknown> {
    const track = source.history.tracks.find((one) => one.sender === sender && one.name === name)!;
    let window = Math.max(LEAST_WINDOW, WINDOW_INTERVALS * (track.interval ?? 0));
    // It began within the window: the counts are of this time alone.
    if (track.first !== null)
      window = Math.min(window, Math.max(now - track.first, track.interval ?? 0, SHORTEST_WINDOW));
    const row: Record<string, unknown> = {
      name,
      sender: senderName(sender),
      count: at === null ? track.count : track.countBetween(-Infinity, at),
      t: null,
      rate: track.countBetween(now - window, at ?? Infinity) / window,
      due: track.interval === null ? null : 1 / track.interval,
      fields: null,
      bytes: null,
    };
    const newest = at === null ? source.newest(sender, name) : source.newestUntil(sender, name, at);
    if (newest) Object.assign(row, { t: newest.t, bytes: hex(newest.raw) }, newest.message ? told(newest.message) : {});
    const column = withSpark ? sparkColumn(source, name, track.columns) : undefined;
    if (column !== undefined) {
      const values = track.samples(column, now - SPARK_SECONDS, now, SPARK_POINTS);
      if (values.some((value) => value !== null)) row.spark = { field: column, values };
    }
    return row;
  }

  private frames(source: Source, now: number, shown: number, at: number | null): Record<string, unknown> | null {
    if (!this.isDue("frames", now, FRAMES_EVERY)) return null;
    const wanted = this.wish.frames as { message?: string | null; discards?: boolean; most?: number };
    const { message = null, discards = true, most = 50 } = wanted;
    const found = source.pieces(most, message, discards, at ?? undefined);
    const marks = JSON.stringify(found.map(({ sender, piece }) => [sender, piece.offset, piece.size]));
    if (marks === this.last.frames) return null;
    this.last.frames = marks;
    const entries = found.map(({ sender, piece }) => {
      const { offset: n, t, size, bytes, name } = piece;
      const stream = source.streams[sender];
      const entry = { n, t, size, direction: sender === HOST ? "sent" : "received", bytes: hex(bytes) };
      if (!name) return { ...entry, kind: stream.isFill(bytes) ? "fill" : "discarded" };
      const read = stream.message(bytes, name, t);
      return { ...entry, kind: "frame", message: name, ...(read ? told(read) : {}) };
    });
    return { t: shown, entries };
  }

  private events(source: Source, at: number | null): Record<string, unknown> | null {
    const known = this.last.events as number | undefined;
    const { newest } = source.happenings;
    if (known === newest) return null;
    this.last.events = newest;
    return { replace: known === undefined, events: source.happenings.since(known ?? 0, at ?? Infinity) };
  }

  private marks(source: Source): Record<string, unknown> | null {
    const known = this.last.marks as [number, number] | undefined;
    const newest: [number, number] = [source.happenings.newest, source.marks.newest];
    if (known?.[0] === newest[0] && known[1] === newest[1]) return null;
    this.last.marks = newest;
    const found = [...source.happenings.since(known?.[0] ?? 0), ...source.marks.since(known?.[1] ?? 0)];
    return { replace: known === undefined, marks: found.sort((a, b) => a.t - b.t) };
  }
}

/** The first column of a plain number; else the first one that is not a time stamp. */
function sparkColumn(source: Source, name: string, columns: string[]): string | undefined {
  const { fields } = source.facts.protocol.messages.find((message) => message.name === name)!;
  const stamps = new Set(fields.filter((field) => field.is_time).map((field) => field.name));
  const numbers = new Set(fields.filter((field) => field.kind === "number").map((field) => field.name));
  const kept = columns.filter((column) => !stamps.has(column));
  return kept.find((column) => numbers.has(column.split("[", 1)[0]!)) ?? kept[0];
}
