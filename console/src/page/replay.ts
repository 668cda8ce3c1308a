// A recording as a source of views: read once, and kept whole.
import { McapStreamReader } from "@mcap/core";
import { decompress } from "fzstd";
import { fromBase64 } from "./base64";
import { Engine, HOST, MCU, type Sender } from "./engine";
import type { Facts } from "./facts";
import { METADATA } from "./recorder";
import type { Replay } from "./rounds";
import { Source, type Read } from "./source";
import type { Store } from "./store";

const PIECE = 1 << 22; // bytes that are read at once
const KEEP = 1 << 30; // bytes of each direction
const MOST = 1 << 30; // bytes of the history
const SENDERS = new Map<string, Sender>([
  ["rx", MCU],
  ["tx", HOST],
]);

/** What a recording says of itself. */
export interface About {
  protocol: string;
  hash: string;
  started: number; // seconds since 1970
}
interface Content {
  about: About | null;
  reads: Record<Sender, Read[]>;
  events: { t: number; kind: string; facts: Record<string, unknown> }[];
  duration: number;
  problems: string[];
}

/** Reads a recording. `module`: the engine's bytes. Throws an `Error` with a sentence. */
export async function openReplay(name: string, file: Blob, module: BufferSource, facts: Facts): Promise<Replay> {
  const { about, reads, events, duration, problems } = await contentOf(file);
  if (!about) throw noRecording(name);
  if (about.hash !== facts.protocol.hash) {
    throw new Error(
      `${name} is a recording of ${about.protocol} (${about.hash}), and this page knows ${facts.protocol.name} ` +
        `(${facts.protocol.hash}); open it with the page of that protocol, or with \`wirebond serve --web\``,
    );
  }
  const engine = await Engine.load(module);
  engine.open(fromBase64(facts.tables));
  const source = new Source(engine, facts, KEEP, MOST);
  const breaks = events.filter((event) => event.kind === "port_down").map((event) => event.t);
  for (const sender of [HOST, MCU] as const) {
    let rest = reads[sender];
    for (const t of breaks) {
      const place = rest.findIndex((read) => read.t >= t);
      const before = place < 0 ? rest : rest.slice(0, place);
      rest = place < 0 ? [] : rest.slice(place);
      source.feed(sender, before);
      source.breakStream(sender);
    }
    source.feed(sender, rest);
  }
  for (const t of breaks) source.history.addBreak(t);
  for (const { t, kind, facts: of } of events) source.happenings.note(t, kind, of);
  source.look(duration);
  return { name, source, duration, problems };
}

/** What a file says of itself, from its first bytes. */
export async function aboutFile(file: Blob): Promise<About | null> {
  return (await contentOf(file.slice(0, 1 << 16))).about;
}

/** Copies a recording into the store; returns the name that it has there. Throws an `Error` with a sentence. */
export async function addRecording(store: Store, name: string, file: Blob): Promise<string> {
  if (!(await aboutFile(file))) throw noRecording(name);
  const taken = await store.names();
  let free = name;
  for (let n = 2; taken.includes(free); n++) free = name.replace(/(\.\w+)?$/, `-${n}$1`);
  const to = await store.create(free);
  for (let at = 0; at < file.size; at += PIECE)
    to.write(new Uint8Array(await file.slice(at, at + PIECE).arrayBuffer()));
  to.flush();
  to.close();
  return free;
}

function noRecording(name: string): Error {
  return new Error(`${name} is not a recording of Wirebond; choose one that \`wirebond record\` or a page made`);
}

async function contentOf(file: Blob): Promise<Content> {
  const content: Content = { about: null, reads: [[], []], events: [], duration: 0, problems: [] };
  const reader = new McapStreamReader({
    decompressHandlers: { zstd: (data, size) => decompress(data, new Uint8Array(Number(size))) },
  });
  const topics = new Map<number, string>();
  let startedNs: bigint | null = null;
  const seconds = (ns: bigint) => Number(ns - (startedNs ?? ns)) / 1e9;
  const take = (record: NonNullable<ReturnType<typeof reader.nextRecord>>) => {
    switch (record.type) {
      case "Metadata":
        if (record.name !== METADATA) return;
        startedNs = BigInt(record.metadata.get("started_ns") ?? "0");
        content.about = {
          protocol: record.metadata.get("protocol") ?? "",
          hash: record.metadata.get("hash") ?? "",
          started: Number(startedNs / 1000n) / 1e6,
        };
        return;
      case "Channel":
        topics.set(record.id, record.topic);
        return;
      case "Message": {
        const topic = topics.get(record.channelId)!;
        const sender = SENDERS.get(topic);
        content.duration = Math.max(content.duration, seconds(record.logTime));
        if (sender !== undefined) {
          content.reads[sender].push({ t: seconds(record.publishTime), bytes: record.data.slice() });
        } else if (topic === "events") {
          const { t, kind, ...of } = JSON.parse(new TextDecoder().decode(record.data)) as { t: number; kind: string };
          content.events.push({ t, kind, facts: of });
        }
      }
    }
  };
  try {
    for (let at = 0; at < file.size; at += PIECE) {
      reader.append(new Uint8Array(await file.slice(at, at + PIECE).arrayBuffer()));
      for (let record; (record = reader.nextRecord());) take(record);
    }
    if (!reader.done()) content.problems.push("it was not closed: everything before its end is shown");
  } catch (error) {
    content.problems.push(`it is damaged: ${(error as Error).message}; everything before the damage is shown`);
  }
  return content;
}
