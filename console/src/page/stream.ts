// One direction of a line: its newest bytes, the frames in them, and the bytes between frames.
import { Engine, type Message, type Rows, type Sender } from "./engine";
import { placeOf } from "./history";

const KEPT_BYTES = 1 << 20; // of a live line: ten seconds at 1 Mbaud
const MOST_DISCARD = 256; // bytes of one entry
const FIRST_BYTES = 1 << 16;

/** A frame, or bytes between two frames (`name` empty). `offset`, of its first byte, names it within its direction. */
export interface Piece {
  t: number;
  offset: number;
  size: number;
  name: string;
  bytes: Uint8Array;
}
/** A value's name, level, place in the payload and size; see engine/include/wirebond/engine/spans.hpp. */
export type Span = [string, number, number, number];
/** `payload`: place and size on the wire; null: stuffing moves the bytes. */
export type Explained =
  | { message: Message; form: number; payload: [number, number] | null; spans: Span[] }
  | { account: { rejected_candidates: Record<string, number> } };
interface Frame {
  t: number;
  offset: number;
  size: number;
  kind: number; // index of the message
}

export class Stream {
  private buffer = new Uint8Array(FIRST_BYTES);
  private begin = 0; // the offset of the first byte that is kept
  private end = 0;
  private readEnds: number[] = []; // of the reads whose bytes are kept, as offsets
  private readTimes: number[] = [];
  private frames: Frame[] = [];
  private settled = 0; // up to here it is known which bytes are in frames
  private discards: { t: number; size: number }[] = [];

  /** `names`: of the messages. `delimiters`: bytes that only separate frames. `keep`: bytes that are kept. `asking`: of
   *  a reply, the index of the request that identifies it. */
  constructor(
    private readonly engine: Engine,
    readonly sender: Sender,
    private readonly names: string[],
    private readonly delimiters: ReadonlySet<number>,
    private readonly asking: ReadonlyMap<string, number>,
    private readonly keep = KEPT_BYTES,
  ) {
    engine.call("restart", undefined, sender);
  }

  get heldBytes(): number {
    return this.buffer.length + 16 * this.readEnds.length + 48 * this.frames.length;
  }

  /** Takes reads as they came: when each began (seconds), and its bytes. Calls `take` with the rows that they complete. */
  feed(reads: { t: number; bytes: Uint8Array }[], take: (rows: Rows[]) => void): void {
    if (reads.length === 0) return;
    const size = reads.reduce((sum, read) => sum + read.bytes.length, 0);
    const input = new Uint8Array(16 * reads.length + size);
    const numbers = new Float64Array(input.buffer, 0, 2 * reads.length);
    let at = 0;
    this.reserve(size);
    reads.forEach((read, i) => {
      input.set(read.bytes, 16 * reads.length + at);
      this.buffer.set(read.bytes, this.end - this.begin);
      at += read.bytes.length;
      this.end += read.bytes.length;
      numbers[i] = read.t * 1e6;
      numbers[reads.length + i] = at;
      this.readEnds.push(this.end);
      this.readTimes.push(read.t);
    });
    this.take(this.engine.rows("follow", input, this.sender, reads.length), take);
    this.trim();
  }

  /** No bytes came up to `t`. */
  idle(t: number, take: (rows: Rows[]) => void): void {
    this.take(this.engine.rows("follow_idle", new Uint8Array(0), this.sender, t * 1e6), take);
  }

  /** The port was closed. */
  breakHere(take: (rows: Rows[]) => void): void {
    this.take(this.engine.rows("follow_break", new Uint8Array(0), this.sender), take);
  }

  /** The next frame answers a request by this message. */
  expect(message: number): void {
    this.engine.do("follow_expect", this.sender, message);
  }

  private take(rows: Rows[], take: (rows: Rows[]) => void): void {
    const added: Frame[] = [];
    for (const of of rows) {
      for (let i = 0; i < of.t.length; i++) {
        added.push({ t: of.t[i]!, offset: Number(of.offset[i]), size: of.size[i]!, kind: of.message });
      }
    }
    take(rows); // before the next call: they are in the engine's memory
    added.sort((a, b) => a.offset - b.offset);
    for (const frame of added) this.frames.push(frame);
    this.noteDiscards(added);
  }

  private noteDiscards(added: Frame[]): void {
    const settled = this.engine.do("settled", this.sender);
    let end = this.settled;
    const note = (begin: number) => {
      if (begin <= end) return;
      const size = this.without(this.raw(end, begin - end)).length;
      if (size > 0 && this.readTimes.length > 0) this.discards.push({ t: this.timeAt(end), size });
    };
    for (const frame of added) {
      note(frame.offset);
      end = frame.offset + frame.size;
    }
    note(settled);
    this.settled = Math.max(settled, end);
  }

  /** When bytes came that are in no frame, and how many, without delimiters: since the last call. */
  takeDiscards(): { t: number; size: number }[] {
    const found = this.discards;
    this.discards = [];
    return found;
  }

  private timeAt(offset: number): number {
    const read = placeOf(this.readEnds, this.readEnds.length, offset, true);
    return this.readTimes[Math.min(read, this.readTimes.length - 1)]!;
  }

  private without(bytes: Uint8Array): Uint8Array {
    let [begin, end] = [0, bytes.length];
    while (begin < end && this.delimiters.has(bytes[begin]!)) begin++;
    while (end > begin && this.delimiters.has(bytes[end - 1]!)) end--;
    return bytes.subarray(begin, end);
  }

  private reserve(size: number): void {
    const needed = this.end - this.begin + size;
    if (needed <= this.buffer.length) return;
    const larger = new Uint8Array(Math.max(2 * this.buffer.length, needed));
    larger.set(this.buffer.subarray(0, this.end - this.begin));
    this.buffer = larger;
  }

  private trim(): void {
    const drop = this.end - this.begin - this.keep;
    if (drop <= this.keep) return;
    this.buffer.copyWithin(0, drop, this.end - this.begin);
    this.begin += drop;
    const reads = placeOf(this.readEnds, this.readEnds.length, this.begin, true);
    this.readEnds.splice(0, reads);
    this.readTimes.splice(0, reads);
    const kept = this.frames.findIndex((frame) => frame.offset >= this.begin);
    this.frames.splice(0, kept < 0 ? this.frames.length : kept);
  }

  // ---- out

  /** These bytes, as far as they are kept: a view that is good until the next feed. */
  raw(offset: number, size: number): Uint8Array {
    const at = Math.max(offset - this.begin, 0);
    return this.buffer.subarray(at, Math.max(Math.min(offset + size, this.end) - this.begin, at));
  }

  /** The message in one frame. */
  message(raw: Uint8Array, name: string, t: number): Message | null {
    const [found] = this.engine.call<Message[]>("read", raw, this.sender, t * 1e6, this.asking.get(name) ?? -1);
    return found ?? null;
  }

  /** Explains the bytes of one frame; if they are none, returns the account of a decoder that reads them alone. */
  explain(raw: Uint8Array, name = ""): Explained {
    return this.engine.call("explain", raw, this.sender, this.asking.get(name) ?? -1);
  }

  /** The last entries, oldest first. `name`: frames of this message alone; null: all; empty: none, and no delimiters
   *  either. `until`: none that came after this time. */
  newest(most: number, name: string | null, withDiscards: boolean, until = Infinity): Piece[] {
    const wanted = name === null ? -1 : name === "" ? -2 : this.names.indexOf(name);
    const found: Piece[] = [];
    for (const piece of this.backwards(wanted, withDiscards, until)) {
      if (name === "" && this.isFill(piece.bytes)) continue;
      found.push(piece);
      if (found.length === most) break;
    }
    return found.reverse();
  }

  private *backwards(wanted: number, withDiscards: boolean, until: number): Generator<Piece> {
    let next = this.settled;
    if (until !== Infinity) {
      const read = placeOf(this.readTimes, this.readTimes.length, until, true);
      next = Math.min(next, read > 0 ? this.readEnds[read - 1]! : 0);
    }
    for (let i = this.frames.length - 1; i >= 0; i--) {
      const { t, offset, size, kind } = this.frames[i]!;
      if (t > until) {
        next = Math.min(next, offset);
        continue;
      }
      if (withDiscards && next > offset + size) yield this.between(offset + size, next);
      next = offset;
      if (offset < this.begin) return;
      if (wanted === -1 || kind === wanted) {
        yield { t, offset, size, name: this.names[kind] ?? "unknown", bytes: this.raw(offset, size) };
      }
    }
    if (withDiscards && next > this.begin) yield this.between(this.begin, next);
  }

  private between(begin: number, end: number): Piece {
    const bytes = this.raw(begin, Math.min(end - begin, MOST_DISCARD));
    return { t: this.timeAt(begin), offset: begin, size: end - begin, name: "", bytes };
  }

  /** Are these bytes nothing but delimiters? */
  isFill(bytes: Uint8Array): boolean {
    return this.delimiters.size > 0 && this.without(bytes).length === 0;
  }
}
