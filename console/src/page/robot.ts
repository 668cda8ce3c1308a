// The host's link over a serial port of the browser: the port's bytes go to the engine, and the engine's to the port. The
// engine decides what leaves and when. The port may go and come back.
import { decode, encode } from "@msgpack/msgpack";
import { fromBase64 } from "./base64";
import type { Clock } from "./clock";
import { EngineError, HOST, MCU, type Engine, type Message } from "./engine";
import type { Facts } from "./facts";
import { PeerBook } from "./peer";
import { portName } from "./portname";
import type { Account } from "./rates";
import { RequestBook } from "./requests";
import { takeTap, type Taken } from "./tap";

/** What a page uses of the standard's `SerialPort`. */
export type Port = Pick<SerialPort, "open" | "close" | "readable" | "writable" | "getInfo"> & {
  readonly connected?: boolean;
};
/** Source of ports: `navigator.serial`, or a stand-in. */
export interface Ports {
  getPorts(): Promise<Port[]>;
}
export const RESULTS = ["ok", "down", "full", "stopped"] as const; // in the order of SendResult
export const STATES = ["down", "stale", "up"] as const;

const TAP_BYTES = 1 << 22;
const BUFFER_BYTES = 1 << 16; // of the browser, for received bytes
const STALLED = 0.05; // seconds without a check: bytes that come then may have waited
const LONGEST_SLEEP = 0.5;
const FIRST_OPEN_WAIT = 0.02; // seconds before a port that went away is tried again
const LAST_OPEN_WAIT = 1;
const SETTLED_AFTER = 1; // a port that lasted so long is not a port that fails at once
export class Robot {
  readonly requests: RequestBook;
  readonly peer: PeerBook;
  why = "";
  private port: Port | null = null;
  private ports: Ports | null = null;
  private wanted: Port | null = null; // the port that shall be open
  private reader: ReadableStreamDefaultReader<Uint8Array> | null = null;
  private wake: () => void = () => {};
  private lookedAt: number; // when the worker last ran with nothing to do
  private heardAt = -Infinity;
  private upSince = 0;
  private openWait = FIRST_OPEN_WAIT;
  private again: ReturnType<typeof setTimeout> | undefined;
  private readonly names: string[];
  private readonly wantedReplies: Uint8Array;
  private readonly hasSafe = new Set<string>(); // message and address
  private isEnded = false;

  constructor(
    private readonly engine: Engine,
    readonly facts: Facts,
    private readonly clock: Clock,
    readonly baud: number,
  ) {
    this.names = facts.protocol.messages.map((message) => message.name);
    this.lookedAt = clock.now();
    this.peer = new PeerBook(facts);
    const replies = Object.values(facts.requests).map((request) => request.reply);
    const wanted = new Set([...replies, ...(facts.hello ? [facts.hello.message] : [])]);
    const indexes = Uint16Array.from(wanted, (name) => this.names.indexOf(name));
    this.wantedReplies = new Uint8Array(indexes.buffer);
    this.requests = new RequestBook(
      facts,
      () => clock.now(),
      (message) => this.addressIn(message),
    );
    const settings = decode(fromBase64(facts.link)) as Record<string, unknown>;
    engine.call("link_open", encode({ ...settings, baud }), this.us());
    engine.do("tap_open", TAP_BYTES, this.us());
    engine.do("port_down", this.us());
  }

  get isUp(): boolean {
    return this.port !== null;
  }
  get state(): (typeof STATES)[number] {
    return STATES[this.engine.do("state", this.us())]!;
  }
  get isStopped(): boolean {
    return this.engine.do("is_stopped") !== 0;
  }
  get portName(): string {
    return portName(this.wanted?.getInfo() ?? {});
  }
  account(): Account {
    return this.engine.call<Account>("link_account");
  }
  struck(): string[] {
    return this.engine.call<number[]>("struck").map((action) => this.facts.actions[action]!);
  }

  private us(): number {
    return Math.round(this.clock.now() * 1e6);
  }

  // ---- the port

  /** Opens this port, and opens it again when it has gone and comes back. Throws an `Error` if it cannot be opened. */
  async connect(port: Port, ports: Ports): Promise<void> {
    this.wanted = port;
    this.ports = ports;
    await this.open(port);
  }

  private async open(port: Port): Promise<void> {
    const { data_bits, parity, stop_bits } = this.facts.protocol.link;
    await port.open({
      baudRate: this.baud,
      dataBits: data_bits as 7 | 8,
      stopBits: Math.round(stop_bits) as 1 | 2,
      parity: parity as ParityType,
      bufferSize: BUFFER_BYTES,
      flowControl: "none",
    });
    if (this.isEnded) {
      await port.close();
      return;
    }
    this.port = this.wanted = port;
    this.why = "";
    this.upSince = this.clock.now();
    this.engine.do("port_up", this.us());
    this.peer.connected(this.upSince);
    void this.read(port);
    void this.write(port);
  }

  private async read(port: Port): Promise<void> {
    while (this.port === port) {
      if (!port.readable) {
        this.goDown(port, "the port was unplugged");
        return;
      }
      try {
        const reader = port.readable.getReader();
        this.reader = reader;
        try {
          for (;;) {
            const { value, done } = await reader.read();
            if (done || this.port !== port) break;
            this.received(value);
          }
        } finally {
          reader.releaseLock();
        }
        if (this.port === port && !port.readable) this.goDown(port, "the port was closed");
      } catch (error) {
        // A frame that the UART could not read, or a full buffer: the stream is another one, and the port stays.
        const name = (error as DOMException).name;
        if (name === "NetworkError" || !port.readable) this.goDown(port, "the port was unplugged");
        else if (!(error instanceof DOMException)) throw error;
      }
    }
  }

  private received(bytes: Uint8Array): void {
    const now = this.clock.now();
    // After a stall it is not known when the bytes came: as early as after the last look.
    const before = now - this.lookedAt > STALLED ? this.lookedAt : now;
    this.engine.doWith("received", bytes, Math.round(before * 1e6), Math.round(now * 1e6));
    this.heardAt = this.lookedAt = now;
    this.takeReplies();
    this.wake();
  }

  private takeReplies(): void {
    for (const message of this.engine.call<Message[]>("receive", this.wantedReplies)) {
      if (message.name === this.facts.hello?.message) this.peer.heard(message.fields, message.t);
      this.requests.take(message);
    }
  }

  private async write(port: Port): Promise<void> {
    const writer = port.writable?.getWriter();
    if (!writer) return;
    try {
      while (this.port === port) {
        this.engine.do("poll", this.us());
        const bytes = this.engine.bytes("hand_over", this.us());
        if (bytes.length === 0) {
          await this.sleep();
          continue;
        }
        await writer.write(bytes);
        if (this.port === port && bytes.length > 1) this.engine.do("written", 1, this.us());
      }
    } catch (error) {
      this.goDown(port, `the port takes no bytes: ${(error as Error).message}`);
    } finally {
      writer.releaseLock();
    }
  }

  private sleep(): Promise<void> {
    const due = (this.engine.do("next_due", this.us()) - this.us()) / 1000;
    const wait = Math.min(Math.max(0, due), 1000 * LONGEST_SLEEP);
    return new Promise((resolve) => {
      const timer = setTimeout(resolve, wait);
      this.wake = () => {
        clearTimeout(timer);
        resolve();
      };
    });
  }

  private goDown(port: Port, why: string): void {
    if (this.port !== port) return;
    this.port = null;
    this.why = why;
    this.wake();
    this.engine.doWith("port_down", new TextEncoder().encode(why), this.us());
    if (this.clock.now() - this.upSince > SETTLED_AFTER) this.openWait = FIRST_OPEN_WAIT;
    void this.close(port).then(() => this.openSoon());
  }

  private async close(port: Port): Promise<void> {
    await this.reader?.cancel().catch(() => {});
    this.reader = null;
    await port.close().catch(() => {}); // one that was unplugged is closed
  }

  private openSoon(): void {
    if (this.isEnded) return;
    clearTimeout(this.again);
    this.again = setTimeout(() => void this.openAgain(), 1000 * this.openWait);
    this.openWait = Math.min(2 * this.openWait, LAST_OPEN_WAIT);
  }

  /** Something was plugged in. */
  appeared(): void {
    if (this.port || this.isEnded || !this.wanted) return;
    this.openWait = FIRST_OPEN_WAIT;
    this.openSoon();
  }

  private async openAgain(): Promise<void> {
    const before = this.wanted!;
    const text = JSON.stringify(before.getInfo());
    const found = (await this.ports!.getPorts()).filter((port) => port.connected !== false);
    const port = found.find((one) => one === before) ?? found.find((one) => JSON.stringify(one.getInfo()) === text);
    if (this.port || this.isEnded) return;
    try {
      if (!port) throw new Error("it is not there");
      await this.open(port);
    } catch {
      this.openSoon();
    }
  }

  // ---- the rhythm

  /** Call it 50 times a second: silence, deadlines, hello. */
  look(): void {
    const now = this.clock.now();
    if (this.heardAt < this.lookedAt && this.port) this.engine.do("link_idle", Math.round(this.lookedAt * 1e6));
    this.lookedAt = now;
    this.engine.do("poll", Math.round(now * 1e6));
    this.takeReplies();
    if (this.port && this.facts.hello && this.peer.isDue(now)) {
      this.peer.asked(now);
      this.sendPlain(this.facts.hello.message, this.peer.hello());
    }
    this.wake();
  }

  private sendPlain(message: string, fields: Record<string, unknown>): void {
    try {
      this.send(message, fields, {}, 0);
    } catch (error) {
      if (!(error instanceof EngineError) && !(error instanceof RefusedError)) throw error;
    }
  }

  // ---- sending

  indexOf(message: string): number {
    const index = this.names.indexOf(message);
    const known = this.facts.protocol.messages[index];
    if (!known) throw new RefusedError("message", `the protocol has no message ${message}; choose one of the list`);
    if (known.sender === "mcu") throw new RefusedError("message", `${message} is sent by the mcu, not by the host`);
    return index;
  }

  /** Offers a frame once, or (`hold` > 0) again and again for so many seconds. Throws a `RefusedError`. */
  send(message: string, fields: Record<string, unknown>, header: Record<string, unknown>, hold: number): void {
    const index = this.indexOf(message);
    const { reply, every } = this.facts.protocol.messages[index]!;
    if (hold > 0 && every === null) {
      throw new RefusedError("refused", `${message} has no \`every\` in the protocol file; send it`);
    }
    const takesNumber = !this.facts.address.numbers.some((name) => name in header);
    const address = this.addressOf(message, index, header);
    const asked = [index, fields, header, reply === null ? -1 : this.names.indexOf(reply), takesNumber, address, hold];
    const result = RESULTS[this.engine.ask<number>("send", asked, this.us())]!;
    this.wake();
    if (result !== "ok") throw this.refusal(message, result);
  }

  /** The bits of the address that a frame with this header is for. A message of the stop gets a safe value for it. */
  addressOf(message: string, index: number, header: Record<string, unknown>): number {
    const { place, names } = this.facts.address;
    if (place === null) return 0;
    const address = Number(this.engine.ask<(number | bigint)[]>("header_bits", header, HOST)[place]);
    const stop = this.facts.stops.find((one) => one.message === message);
    const key = `${message} ${address}`;
    if (!stop || this.hasSafe.has(key) || this.isStopped) return address;
    const own = Object.fromEntries(Object.entries(header).filter(([name]) => names.includes(name)));
    const frame = this.engine.ask<Uint8Array>("encode", [index, stop.fields, { ...stop.header, ...own }], HOST);
    const { reply } = this.facts.protocol.messages[index]!;
    const safe = [index, frame, reply === null ? -1 : this.names.indexOf(reply), stop.every, address, !stop.covered];
    if (!this.engine.ask<boolean>("note_safe", safe)) {
      throw new RefusedError("full", `${message} went to too many addresses already, and each has its safe value`);
    }
    this.hasSafe.add(key);
    return address;
  }

  /** The values of a message as the other end reads them: a request is compared with its reply so. */
  asOnWire(index: number, fields: Record<string, unknown>, header: Record<string, unknown>): Record<string, unknown> {
    const frame = this.engine.ask<Uint8Array>("encode", [index, fields, header], HOST);
    const [message] = this.engine.call<Message[]>("read", frame, HOST, 0, -1);
    return message?.fields ?? {};
  }

  private addressIn(message: Message): number | null {
    const { from } = this.facts.address;
    if (from === null || !(from in message.header)) return null;
    const place = this.facts.protocol.header.findIndex((field) => field.name === from);
    return Number(this.engine.ask<(number | bigint)[]>("header_bits", message.header, MCU)[place]);
  }

  private refusal(message: string, result: string): RefusedError {
    if (result === "stopped") {
      return new RefusedError("stopped", `${message} was not sent: the emergency stop holds; release it first`);
    }
    if (result === "full") {
      return new RefusedError("full", `the send queue is full; ${message} was not sent. Send less often`);
    }
    return new RefusedError("down", `${message} was not sent: ${this.why || "the port is not connected"}`);
  }

  stopRepeating(message: string, address: number | null): void {
    this.engine.do("stop_repeating", this.indexOf(message), address ?? -1);
  }

  endSafely(message: string, address: number): boolean {
    const has = this.engine.do("end_safely", this.indexOf(message), address) !== 0;
    this.wake();
    return has;
  }

  /** Ends every lease, and sends the safe values of the messages that moved something. */
  endMotion(): void {
    this.engine.do("end_motion");
    this.wake();
  }

  handOver(): void {
    this.engine.do("hand_over_motion");
  }

  stop(): void {
    this.engine.do("stop", this.us());
    this.wake();
  }

  releaseStop(): void {
    this.engine.do("release_stop");
  }

  recover(action: number): void {
    this.engine.do("recover_deadline", action, this.us());
  }

  note(kind: string, facts: Record<string, unknown>): void {
    this.engine.doWith("note", new TextEncoder().encode(JSON.stringify({ kind, ...facts })), this.us());
  }

  /** What happened since the last call. */
  take(): Taken {
    return takeTap(this.engine, this.facts);
  }

  /** Ends everything: leases end with their safe values, queued frames may leave for a moment, the port is closed. */
  async end(): Promise<void> {
    if (this.isEnded) return;
    this.isEnded = true;
    clearTimeout(this.again);
    this.engine.do("close");
    this.wake();
    for (let tries = 0; tries < 50 && this.port && this.engine.do("is_empty") === 0; tries++) {
      await new Promise((resolve) => setTimeout(resolve, 10));
    }
    const port = this.port;
    if (!port) return;
    this.port = null;
    this.wake();
    await Promise.resolve(); // the writer lets go of the port
    this.engine.do("port_down", this.us());
    await this.close(port);
  }
}

/** A refusal in words; `word` is one of docs/server.md. */
export class RefusedError extends Error {
  constructor(
    readonly word: string,
    text: string,
  ) {
    super(text);
  }
}
