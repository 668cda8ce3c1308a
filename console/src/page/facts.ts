// The file that `wirebond gen FILE --lang page` writes for one protocol: facts that the engine does not have.
import type { Protocol } from "../protocol";

export const VERSION = 3;

/** How a request finds its reply; see wirebond/protocol/replies.py. */
export interface Request {
  reply: string;
  /** Fields that every reply carries back: it answers this request and no other. */
  carried: string[];
  /** Fields that identify the reply where it has them. */
  identifying: string[];
}
/** A message of the emergency stop, as the link takes it for an address. */
export interface Stop {
  message: string;
  fields: Record<string, unknown>;
  header: Record<string, unknown>;
  every: number; // seconds between two while a stop holds
  covered: boolean; // the file's own address is a broadcast
}
export interface FramePart {
  name: string;
  size: number | null; // bytes; null: the payload
  header: string[]; // the header fields in it
  is_id: boolean;
}
export interface Facts {
  version: number;
  wirebond: string; // the release that wrote it
  protocol: Protocol;
  document: { markdown: string; markdown_zh: string };
  lint: unknown;
  tables: string; // base64: for the engine's `open`
  link: string; // base64: for the engine's `link_open`
  adapter_latency: number; // seconds that the port may hold bytes back
  actions: string[]; // of deadlines at the host, in the engine's order
  delimiters: { mcu: number[]; host: number[] };
  /** By the sender: the parts of its frames, for each form that the engine knows. */
  forms: { mcu: FramePart[][]; host: FramePart[][] };
  /** Replies of the MCU are identified only by requests. */
  told: boolean;
  requests: Record<string, Request>;
  stops: Stop[];
  /** The header fields: which says for whom a frame is, who sent one, and addresses that mean all. */
  address: {
    place: number | null; // among the header fields of the host's frames: for whom one is
    names: string[]; // header fields that are addresses
    numbers: string[]; // those that count frames
    from: string | null; // of the MCU's frames: who sent one
    broadcasts: number[];
  };
  /** By message. `pieces`: texts, with field values between them; null: the message has level and text. */
  log: Record<string, { level: string; pieces: (string | { field: string; decimals: number | null })[] | null }>;
  /** The message that identifies an end's file, and this end's values in it. */
  hello: { message: string; fields: Record<string, unknown> } | null;
  /** Tables for `Chinese`. */
  chinese: string;
}
