// What views show: a line's history, its newest bytes and its events. A live link and a recording are both one.
import { HOST, MCU, SENDERS, senderName, type Engine, type Message, type Rows, type Sender } from "./engine";
import type { Facts } from "./facts";
import { Happenings, Marks } from "./happenings";
import { History } from "./history";
import { logText } from "./log";
import { McuDeadlines, type Sent } from "./mcudeadlines";
import { Stream, type Piece } from "./stream";
import { RoundTrips } from "./trips";

const MOST_LOG_LINES = 100; // a second

/** One read or write: when it began, in seconds. */
export interface Read {
  t: number;
  bytes: Uint8Array;
}
export interface Newest {
  t: number;
  raw: Uint8Array;
  message: Message | null | undefined; // undefined: not decoded yet
}
/** What the views show of a message. */
export function told(message: Message): Record<string, unknown> {
  const out: Record<string, unknown> = { fields: plain(message.fields) };
  if (Object.keys(message.header).length > 0) out.header = plain(message.header);
  if (message.violations.length > 0) out.violations = message.violations;
  if (message.name === "unknown") out.id = message.id;
  return out;
}
/** Values as JSON has them: bytes as digits, no number that JSON lacks. */
export function plain(value: unknown): unknown {
  if (value instanceof Uint8Array) return hex(value);
  if (Array.isArray(value)) return value.map(plain);
  if (typeof value === "bigint") return Number(value);
  if (typeof value === "number") return Number.isFinite(value) ? value : null;
  if (value !== null && typeof value === "object") {
    return Object.fromEntries(Object.entries(value).map(([name, one]) => [name, plain(one)]));
  }
  return value;
}
const DIGITS = Array.from({ length: 256 }, (_, byte) => byte.toString(16).padStart(2, "0"));
export function hex(bytes: Uint8Array): string {
  let text = "";
  for (const byte of bytes) text += DIGITS[byte]!;
  return text;
}

export class Source {
  readonly history: History;
  readonly happenings = new Happenings();
  readonly marks = new Marks();
  readonly trips = new RoundTrips();
  readonly mcuDeadlines: McuDeadlines;
  readonly streams: Record<Sender, Stream>;
  private readonly newestOf = new Map<string, Newest>(); // by sender and index
  private readonly names: string[];
  private readonly fed: Record<Sender, number> = [0, 0];
  private asked: { t: number; reply: number }[] = []; // requests that no read has followed
  private lines = { began: -Infinity, passed: 0 }; // log lines of this second

  /** `keep`, `most`: bytes of each direction, and of the history. The engine's followers are this source's. */
  constructor(
    engine: Engine,
    readonly facts: Facts,
    keep?: number,
    most?: number,
  ) {
    const { protocol } = facts;
    this.names = protocol.messages.map((message) => message.name);
    this.history = new History(protocol, engine.columns, most);
    this.mcuDeadlines = new McuDeadlines(protocol);
    const asking = new Map<string, number>();
    for (const [name, request] of Object.entries(facts.requests)) asking.set(request.reply, this.names.indexOf(name));
    const stream = (sender: Sender) => {
      const delimiters = new Set(facts.delimiters[senderName(sender)]);
      const isTold = sender === MCU && facts.told;
      const told = new Map([...asking].map(([reply]) => [reply, this.names.indexOf(reply)]));
      return new Stream(engine, sender, this.names, delimiters, isTold ? told : new Map<string, number>(), keep);
    };
    this.streams = [stream(MCU), stream(HOST)];
  }

  /** Bytes that this end sent. Feed the host's before the MCU's of the same time. */
  feed(sender: Sender, reads: Read[]): void {
    if (reads.length === 0) return;
    this.fed[sender] = reads.at(-1)!.t;
    const stream = this.streams[sender];
    const take = (rows: Rows[]) => this.take(sender, rows);
    let from = 0;
    if (sender === MCU && this.asked.length > 0) {
      const asked = this.asked;
      this.asked = [];
      for (const { t, reply } of asked) {
        const before = reads.findIndex((read, place) => place >= from && read.t >= t);
        const to = before < 0 ? reads.length : before;
        stream.feed(reads.slice(from, to), take);
        stream.expect(reply);
        from = to;
      }
    }
    stream.feed(from === 0 ? reads : reads.slice(from), take);
    this.markDiscards(sender);
  }

  /** No bytes of this end came up to `t`. */
  idle(sender: Sender, t: number): void {
    if (this.fed[sender] === 0 || t <= this.fed[sender]) return;
    this.fed[sender] = 0;
    this.streams[sender].idle(t, (rows) => this.take(sender, rows));
    this.markDiscards(sender);
  }

  /** The port was closed: a frame that was under way is over. */
  breakStream(sender: Sender): void {
    this.streams[sender].breakHere((rows) => this.take(sender, rows));
    this.markDiscards(sender);
  }

  /** It is this late: marks the deadlines at the MCU that have struck. */
  look(now: number): void {
    for (const { t, action, message } of this.mcuDeadlines.strikes(now)) this.marks.struck(t, action, message);
  }

  get bytes(): number {
    return this.history.bytes + this.streams[MCU].heldBytes + this.streams[HOST].heldBytes;
  }

  private markDiscards(sender: Sender): void {
    const direction = sender === HOST ? "sent" : "received";
    for (const { t, size } of this.streams[sender].takeDiscards()) this.marks.discarded(t, direction, size);
  }

  private take(sender: Sender, all: Rows[]): void {
    this.history.add(sender, all); // first: the rows are in the engine's memory, which the calls below change
    const found = all.map((rows) => ({
      index: rows.message,
      times: Array.from(rows.t),
      places: Array.from(rows.offset, (offset, i) => ({ offset: Number(offset), size: rows.size[i]! })),
    }));
    const stream = this.streams[sender];
    const sent: (Sent & { offset: number })[] = [];
    for (const { index, times, places } of found) {
      const name = this.names[index] ?? "unknown";
      const last = places.at(-1)!;
      const raw = stream.raw(last.offset, last.size).slice();
      this.newestOf.set(`${sender} ${index}`, { t: times.at(-1)!, raw, message: undefined });
      const request = this.facts.requests[name];
      if (sender === HOST && request) {
        this.trips.ask(request.reply, times);
        const reply = this.names.indexOf(request.reply);
        if (this.facts.told) this.asked.push(...times.map((t) => ({ t, reply })));
      } else if (sender === MCU) this.trips.answer(name, times);
      const read = (i: number) => stream.message(stream.raw(places[i]!.offset, places[i]!.size), name, times[i]!);
      if (sender === HOST && this.mcuDeadlines.names.has(name)) {
        times.forEach((t, i) =>
          sent.push({ t, name, offset: places[i]!.offset, fields: () => read(i)?.fields ?? null }),
        );
      }
      if (this.facts.log[name]) times.forEach((t, i) => this.noteLine(name, t, () => read(i)));
    }
    if (sent.length > 0) this.mcuDeadlines.sent(sent.sort((a, b) => a.offset - b.offset));
  }

  private noteLine(name: string, t: number, read: () => Message | null): void {
    if (t - this.lines.began >= 1) this.lines = { began: t, passed: 0 };
    if (++this.lines.passed > MOST_LOG_LINES) return;
    const message = read();
    if (!message) return;
    this.happenings.note(t, "log", { ...logText(this.facts.log[name]!, message.fields), message: name });
  }

  // ---- out

  /** The newest frame of this message, decoded. */
  newest(sender: Sender, name: string): Newest | null {
    const index = this.names.indexOf(name);
    const found = this.newestOf.get(`${sender} ${index}`);
    if (!found) return null;
    if (found.message === undefined) found.message = this.streams[sender].message(found.raw, name, found.t);
    return found;
  }

  newestUntil(sender: Sender, name: string, until: number): Newest | null {
    const [piece] = this.streams[sender].newest(1, name, false, until);
    if (!piece) return null;
    const raw = piece.bytes.slice();
    return { t: piece.t, raw, message: this.streams[sender].message(raw, name, piece.t) };
  }

  /** When the newest frame of this end came; null: none did. */
  heard(sender: Sender): number | null {
    let newest: number | null = null;
    for (const [key, { t }] of this.newestOf) if (key.startsWith(`${sender} `)) newest = Math.max(newest ?? t, t);
    return newest;
  }

  /** The last frames and the bytes between frames, of both ends in the order of time. */
  pieces(most: number, name: string | null, withDiscards: boolean, until?: number): { sender: Sender; piece: Piece }[] {
    const found = SENDERS.flatMap((sender) =>
      this.streams[sender].newest(most, name, withDiscards, until).map((piece) => ({ sender, piece })),
    );
    return found.sort((a, b) => a.piece.t - b.piece.t).slice(-most);
  }
}
