// A recording while it grows, as `wirebond record` writes it before it is closed: wirebond/recording/layout.py has the
// layout.
import { McapWriter } from "@mcap/core";
import type { Clock } from "./clock";
import type { Facts } from "./facts";
import type { Growing, Store } from "./store";
import type { Taken } from "./tap";

export const METADATA = "wirebond";
const PROFILE = "wirebond";
const VERSION = "1";
const EVENT_SCHEMA = JSON.stringify({
  title: "wirebond.Event",
  type: "object",
  properties: { t: { type: "number", description: "seconds since the start" }, kind: { type: "string" } },
  required: ["t", "kind"],
});
const text = new TextEncoder();

/** Collects the writer's bytes for one write to the file. */
class Batch {
  private parts: Uint8Array[] = [];
  private size = 0n;

  write(bytes: Uint8Array): Promise<void> {
    this.parts.push(bytes.slice());
    this.size += BigInt(bytes.length);
    return Promise.resolve();
  }

  position(): bigint {
    return this.size;
  }

  take(): Uint8Array {
    const out = new Uint8Array(this.parts.reduce((sum, part) => sum + part.length, 0));
    let at = 0;
    for (const part of this.parts) {
      out.set(part, at);
      at += part.length;
    }
    this.parts = [];
    return out;
  }
}

export class Recorder {
  size = 0;
  messages = 0;
  error = "";
  seconds: number | null = null; // once it has ended
  lost = 0; // pieces
  readonly started: number;
  readonly startedWall: number;
  private readonly batch = new Batch();
  private readonly writer = new McapWriter({ writable: this.batch, useChunks: false });
  private channels = { received: 0, sent: 0, events: 0 };
  private working: Promise<void>;
  private readonly wallNs: bigint;

  private constructor(
    readonly name: string,
    private readonly file: Growing,
    private readonly facts: Facts,
    private readonly clock: Clock,
    port: string,
    baud: number,
  ) {
    this.started = clock.now();
    this.startedWall = Date.now() / 1000;
    this.wallNs = BigInt(Math.round(this.startedWall * 1e6)) * 1000n;
    this.working = this.begin(port, baud);
  }

  static async start(store: Store, facts: Facts, clock: Clock, port: string, baud: number): Promise<Recorder> {
    const stamp = new Date().toISOString().slice(0, 19).replace(/[-:]/g, "").replace("T", "-");
    const taken = await store.names();
    let name = `${facts.protocol.name}-${stamp}.mcap`;
    for (let n = 2; taken.includes(name); n++) name = `${facts.protocol.name}-${stamp}-${n}.mcap`;
    const recorder = new Recorder(name, await store.create(name), facts, clock, port, baud);
    await recorder.working;
    return recorder;
  }

  private async begin(port: string, baud: number): Promise<void> {
    const { protocol } = this.facts;
    await this.writer.start({ profile: PROFILE, library: `wirebond ${this.facts.wirebond} page` });
    await this.writer.addMetadata({
      name: METADATA,
      metadata: new Map([
        ["version", VERSION],
        ["protocol", protocol.name],
        ["hash", protocol.hash],
        ["role", "host"],
        ["started_ns", String(this.wallNs)],
        ["monotonic_us", String(Math.round(this.started * 1e6))],
        ["port", port],
        ["baud", String(baud)],
        ["adapter_latency", String(this.facts.adapter_latency)],
      ]),
    });
    await this.writer.addAttachment({
      name: "protocol.yaml",
      logTime: this.wallNs,
      createTime: this.wallNs,
      mediaType: "application/yaml",
      data: text.encode(protocol.text),
    });
    const schema = { name: "wirebond.Event", encoding: "jsonschema", data: text.encode(EVENT_SCHEMA) };
    const schemaId = await this.writer.registerSchema(schema);
    const channel = (topic: string, messageEncoding: string, id: number) =>
      this.writer.registerChannel({ topic, messageEncoding, schemaId: id, metadata: new Map() });
    this.channels.received = await channel("rx", "raw", 0);
    this.channels.sent = await channel("tx", "raw", 0);
    this.channels.events = await channel("events", "json", schemaId);
    this.flush();
  }

  /** What came. It is written later, in its order. */
  add(taken: Taken, messages: number): void {
    if (this.error || this.seconds !== null) return;
    this.messages += messages;
    this.lost += taken.lost;
    this.working = this.working.then(() => this.write(taken)).catch((error: Error) => this.fail(error));
  }

  private async write(taken: Taken): Promise<void> {
    const all = [
      ...taken.received.map(({ t, done, bytes }) => ({ channel: this.channels.received, t, done, bytes })),
      ...taken.sent.map(({ t, done, bytes }) => ({ channel: this.channels.sent, t, done, bytes })),
      ...taken.events.map(({ t, kind, facts }) => {
        const event = { t: Math.round((t - this.started) * 1e6) / 1e6, kind, ...facts };
        return { channel: this.channels.events, t, done: t, bytes: text.encode(JSON.stringify(event)) };
      }),
    ].sort((a, b) => a.done - b.done);
    for (const { channel, t, done, bytes } of all) {
      const [logTime, publishTime] = [this.ns(done), this.ns(t)];
      await this.writer.addMessage({ channelId: channel, sequence: 0, logTime, publishTime, data: bytes });
    }
    this.flush();
  }

  private ns(t: number): bigint {
    return this.wallNs + BigInt(Math.round((t - this.started) * 1e6)) * 1000n;
  }

  private flush(): void {
    const bytes = this.batch.take();
    if (bytes.length === 0) return;
    this.file.write(bytes);
    this.file.flush();
    this.size += bytes.length;
  }

  private fail(error: Error): void {
    if (this.error) return;
    this.error =
      `the recording ${this.name} ended early: ${error.message}. Download it, then delete old recordings; everything ` +
      "written before that can be read";
    this.seconds = this.clock.now() - this.started;
    this.file.close();
  }

  /** Ends the file. It is whole then. */
  async close(): Promise<void> {
    if (this.seconds !== null) return;
    this.seconds = this.clock.now() - this.started;
    this.working = this.working
      .then(async () => {
        await this.writer.end();
        this.flush();
        this.file.close();
      })
      .catch((error: Error) => this.fail(error));
    await this.working;
  }
}
