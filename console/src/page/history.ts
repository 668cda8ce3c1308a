// The newest values of all messages in bounded memory, for plots and tables; and a plot's pixels: least and greatest
// values, with gaps. The shapes are those of docs/console-api.md, "Plots".
import type { Rows, Sender } from "./engine";
import { HOST, MCU, senderName } from "./engine";
import type { Protocol } from "../protocol";

const MOST_BYTES = 128 << 20;
const ROWS = 1 << 16; // of a whole chunk
const FIRST_ROWS = 1 << 8;
const MOST_ELEMENTS = 64; // of an array that is kept element by element
const GAP = 3; // intervals of a message, after which its absence is a gap
const BURST = 1 / 8; // of a silence: bytes so soon after it were sent during it, and waited in an adapter
const MOST_BREAKS = 10_000;

/** The first place whose value is at least `t` (`after`: greater than it). `values` rise. */
export function placeOf(values: ArrayLike<number>, length: number, t: number, after = false): number {
  let low = 0;
  let high = length;
  while (low < high) {
    const middle = (low + high) >> 1;
    const value = values[middle]!;
    if (value < t || (after && value === t)) low = middle + 1;
    else high = middle;
  }
  return low;
}

interface Chunk {
  rows: number;
  t: Float64Array;
  columns: Float64Array[];
}
/** Where a column comes from: the place among the engine's columns, the element, and how many there are in each row. */
interface From {
  place: number;
  element: number;
  stride: number;
}
/** Rows of equal length: the time of a pixel's first sample, its least and its greatest value. NaN: a gap. */
export interface Pixels {
  t: number[];
  low: number[];
  high: number[];
  /** The time of the first row that later samples may change; with an undecided gap that of the last row before it. */
  open: number;
}

/** All rows that are kept of one message of one end, in the order of time. */
export class Track {
  readonly columns: string[] = [];
  count = 0; // of all that ever came
  chunks: Chunk[] = [];
  private readonly from: From[] = [];

  constructor(
    readonly sender: Sender,
    readonly name: string,
    engineColumns: [string, number][],
    readonly interval: number | null, // seconds between two of them, where the file says so
  ) {
    engineColumns.forEach(([column, stride], place) => {
      const isLong = [...column.matchAll(/\[(\d+)\]/g)].some(([, index]) => Number(index) >= MOST_ELEMENTS);
      if (isLong || stride > MOST_ELEMENTS) return;
      for (let element = 0; element < stride; element++) {
        this.columns.push(stride === 1 ? column : `${column}[${element}]`);
        this.from.push({ place, element, stride });
      }
    });
  }

  get bytes(): number {
    return this.chunks.reduce((sum, chunk) => sum + chunk.t.byteLength * (1 + chunk.columns.length), 0);
  }
  get first(): number | null {
    return this.chunks[0]?.t[0] ?? null;
  }
  get last(): number | null {
    const chunk = this.chunks.at(-1);
    return chunk ? chunk.t[chunk.rows - 1]! : null;
  }

  append(rows: Rows): void {
    const count = rows.t.length;
    this.count += count;
    for (let at = 0; at < count;) {
      let chunk = this.chunks.at(-1);
      if (!chunk || chunk.rows === ROWS) this.chunks.push((chunk = this.chunk(FIRST_ROWS)));
      const taken = Math.min(count - at, ROWS - chunk.rows);
      this.reserve(chunk, chunk.rows + taken);
      chunk.t.set(rows.t.subarray(at, at + taken), chunk.rows);
      this.from.forEach(({ place, element, stride }, c) => {
        const source = rows.columns[place]!;
        const to = chunk.columns[c]!;
        if (stride === 1) to.set(source.subarray(at, at + taken), chunk.rows);
        else for (let i = 0; i < taken; i++) to[chunk.rows + i] = source[(at + i) * stride + element]!;
      });
      chunk.rows += taken;
      at += taken;
    }
  }

  private chunk(size: number): Chunk {
    return { rows: 0, t: new Float64Array(size), columns: this.columns.map(() => new Float64Array(size)) };
  }

  private reserve(chunk: Chunk, rows: number): void {
    let size = chunk.t.length;
    if (rows <= size) return;
    while (size < rows) size *= 2;
    const larger = (values: Float64Array) => {
      const to = new Float64Array(size);
      to.set(values);
      return to;
    };
    chunk.t = larger(chunk.t);
    chunk.columns = chunk.columns.map(larger);
  }

  /** Calls `take` for each chunk with rows from `begin` to `end`, both included, oldest first. */
  each(begin: number, end: number, take: (chunk: Chunk, from: number, to: number) => void): void {
    for (const chunk of this.chunks) {
      if (chunk.t[chunk.rows - 1]! < begin) continue;
      if (chunk.t[0]! > end) return;
      const from = placeOf(chunk.t, chunk.rows, begin);
      const to = placeOf(chunk.t, chunk.rows, end, true);
      if (to > from) take(chunk, from, to);
    }
  }

  /** How many rows have a time from `begin` to `end`, both included. */
  countBetween(begin: number, end: number): number {
    let total = 0;
    this.each(begin, end, (_, from, to) => (total += to - from));
    return total;
  }

  /** The last value in each of `points` parts of equal length from `begin` to `end`; null where there is none. */
  samples(column: string, begin: number, end: number, points: number): (number | null)[] {
    const place = this.columns.indexOf(column);
    const out = new Array<number | null>(points).fill(null);
    this.each(begin, end, (chunk, from, to) => {
      for (let i = from; i < to; i++) {
        const part = Math.min(points - 1, Math.floor(((chunk.t[i]! - begin) / (end - begin)) * points));
        const value = chunk.columns[place]![i]!;
        if (Number.isFinite(value)) out[part] = value;
      }
    });
    return out;
  }

  /** The samples of a column from `begin` to `end`, both included. Pixels are `width` seconds and begin at multiples of
   *  it, so that two calls with one width have the same pixels. `breaks`: when the line went away, rising. */
  pixels(column: string, begin: number, end: number, width: number, breaks: number[]): Pixels {
    const place = this.columns.indexOf(column);
    const found: Pixels = { t: [], low: [], high: [], open: NaN };
    const last: number[] = []; // the time of each pixel's last sample
    let pixel = NaN;
    this.each(begin, end, (chunk, from, to) => {
      const values = chunk.columns[place]!;
      for (let i = from; i < to; i++) {
        const t = chunk.t[i]!;
        const value = values[i]!;
        const here = Math.floor(t / width);
        const row = found.t.length - 1;
        if (here !== pixel) {
          pixel = here;
          found.t.push(t);
          found.low.push(value);
          found.high.push(value);
          last.push(t);
          continue;
        }
        last[row] = t;
        if (value < found.low[row]! || Number.isNaN(found.low[row]!)) found.low[row] = value;
        if (value > found.high[row]! || Number.isNaN(found.high[row]!)) found.high[row] = value;
      }
    });
    return found.t.length === 0 ? found : this.withGaps(found, last, breaks);
  }

  private withGaps(found: Pixels, last: number[], breaks: number[]): Pixels {
    const { t } = found;
    const before = new Set<number>(); // rows that nothing came before for too long
    let open = t.at(-1)!;
    if (this.interval !== null) {
      for (let i = 1; i < t.length; i++) {
        const silent = t[i]! - last[i - 1]!;
        if (silent <= GAP * this.interval) continue;
        const until = t[i]! + BURST * silent;
        if (silent > (GAP - 1 + this.countBetween(t[i]!, until)) * this.interval) before.add(i);
        if (until > (this.last ?? 0)) open = Math.min(open, t[i - 1]!);
      }
    }
    for (let b = placeOf(breaks, breaks.length, t[0]!); b < breaks.length && breaks[b]! <= t.at(-1)!; b++) {
      const row = placeOf(t, t.length, breaks[b]!);
      if (row > 0 && row < t.length && last[row - 1]! <= breaks[b]!) before.add(row);
    }
    const out: Pixels = { t: [], low: [], high: [], open };
    for (let i = 0; i < t.length; i++) {
      if (before.has(i)) {
        out.t.push(last[i - 1]! + 1e-9);
        out.low.push(NaN);
        out.high.push(NaN);
      }
      out.t.push(t[i]!);
      out.low.push(found.low[i]!);
      out.high.push(found.high[i]!);
    }
    return out;
  }
}

/** The tracks of both ends. */
export class History {
  readonly tracks: Track[] = [];
  readonly breaks: number[] = [];
  private readonly byMessage = new Map<string, Track>(); // by sender and index of the message

  /** `most`: bytes that are kept of all messages; the oldest go first. */
  constructor(
    protocol: Protocol,
    columns: [string, number][][],
    readonly most = MOST_BYTES,
  ) {
    for (const sender of [HOST, MCU] as const) {
      protocol.messages.forEach((message, index) => {
        if (message.sender !== "both" && message.sender !== senderName(sender)) return;
        const asked = protocol.messages.find((one) => one.reply === message.name && one.every !== null);
        const track = new Track(sender, message.name, columns[index]!, message.every ?? asked?.every ?? null);
        this.tracks.push(track);
        this.byMessage.set(`${sender} ${index}`, track);
      });
    }
  }

  track(sender: Sender, message: number): Track | undefined {
    return this.byMessage.get(`${sender} ${message}`);
  }

  /** Rows of one end that are newer than all of that end. */
  add(sender: Sender, all: Rows[]): void {
    for (const rows of all) this.track(sender, rows.message)?.append(rows);
    while (this.bytes > this.most) {
      const [oldest] = this.tracks.filter((track) => track.chunks.length > 1).sort((a, b) => a.first! - b.first!);
      if (!oldest) return;
      oldest.chunks.shift();
    }
  }

  /** The line went away at this time. */
  addBreak(t: number): void {
    this.breaks.push(t);
    if (this.breaks.length > MOST_BREAKS) this.breaks.shift();
  }

  get bytes(): number {
    return this.tracks.reduce((sum, track) => sum + track.bytes, 0);
  }

  /** The times of the oldest and the newest row; null: there is none. */
  range(): [number, number] | null {
    const tracks = this.tracks.filter((track) => track.chunks.length > 0);
    if (tracks.length === 0) return null;
    return [Math.min(...tracks.map((track) => track.first!)), Math.max(...tracks.map((track) => track.last!))];
  }

  /** Track and column of a name such as `status.battery` or `host:ping.number`. Throws an `Error` with a sentence. */
  find(field: string): { track: Track; column: string } {
    const [, given, name, column] = /^(?:(host|mcu):)?([^.]*)\.?(.*)$/s.exec(field)!;
    const named = this.tracks.filter((track) => track.name === name && (!given || senderName(track.sender) === given));
    const track = named.find((one) => one.sender === MCU) ?? named[0];
    if (!track) throw new Error(`${field} names no message of this protocol; choose one from the list`);
    if (!track.columns.includes(column!)) {
      throw new Error(`${field}: ${name} has no such field that can be plotted; choose one from the list`);
    }
    return { track, column: column! };
  }
}
