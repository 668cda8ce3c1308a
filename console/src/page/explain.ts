// Explains the bytes of a frame, or why other bytes are none: as `/api/explain` of a server, without its guesses.
import type { Explanation, Part, Stretch } from "../frame";
import { withUnit, type Field, type Protocol } from "../protocol";
import { HOST, MCU, SENDERS, type Message, type Sender } from "./engine";
import type { FramePart } from "./facts";
import { hex, type Source } from "./source";
import type { Explained } from "./stream";

type Found = Extract<Explained, { message: Message }>;

/** `sender`: null: either end. */
export function explain(source: Source, bytes: Uint8Array, sender: "host" | "mcu" | null): Explanation {
  const senders: readonly Sender[] = sender === null ? SENDERS : [sender === "host" ? HOST : MCU];
  const causes = new Set<string>();
  for (const one of senders) {
    const found = source.streams[one].explain(bytes);
    if ("message" in found) {
      const parts = source.facts.forms[one === HOST ? "host" : "mcu"][found.form] ?? [];
      const { protocol } = source.facts;
      const rows = found.payload ? placedRows(protocol, bytes, found, found.payload, parts) : rowsOf(protocol, found);
      return { stretches: [stretch("frame", hex(bytes), found.message.name, rows)] };
    }
    for (const [cause, count] of Object.entries(found.account.rejected_candidates)) if (count > 0) causes.add(cause);
  }
  const why = [...causes].map((cause) => cause.replaceAll("_", " ")).join(", ") || "no frame begins here";
  return { stretches: [stretch("refused", hex(bytes), why, [])] };
}

function stretch(kind: Stretch["kind"], wire: string, summary: string, rows: Part[]): Stretch {
  return { kind, offset: 0, wire, cause: "", summary, rows, rules: [], guesses: [] };
}

function placedRows(
  protocol: Protocol,
  bytes: Uint8Array,
  found: Found,
  [payload, payloadSize]: [number, number],
  parts: FramePart[],
): Part[] {
  const { message } = found;
  const rows: Part[] = [];
  const add = (name: string, offset: number, size: number, meaning: string): void => {
    const data = hex(bytes.subarray(offset, offset + size));
    if (size > 0) rows.push({ name, level: 0, offset, wire: data, data, meaning, state: "good" });
  };
  const place = parts.findIndex(({ size }) => size === null);
  let at = payload - parts.slice(0, place).reduce((sum, { size }) => sum + size!, 0);
  add("delimiter", 0, at, "");
  for (const part of parts) {
    const size = part.size ?? payloadSize;
    add(part.name, at, size, partText(part, message));
    if (part.size === null) {
      for (const [index, row] of rowsOf(protocol, found).entries()) {
        const [, , from, length] = found.spans[index]!;
        const [first, last] = [Math.min(from, size), Math.min(from + length, size)]; // zeros at the end may be left out
        row.offset = payload + first;
        row.wire = row.data = hex(bytes.subarray(payload + first, payload + last));
        rows.push(row);
      }
    }
    at += size;
  }
  add("delimiter", at, bytes.length - at, "");
  return rows;
}

/** The values, without places. */
function rowsOf(protocol: Protocol, { message, spans }: Found): Part[] {
  return spans.map(([path, level]) => {
    const name = path.slice(path.lastIndexOf(".") + 1);
    return { name, level, offset: 0, wire: "", data: "", meaning: valueAt(protocol, message, path), state: "named" };
  });
}

function partText(part: FramePart, message: Message): string {
  if (part.is_id) return message.name;
  const single = part.header.length === 1 && part.header[0] === part.name;
  return part.header
    .filter((name) => name in message.header)
    .map((name) => (single ? "" : `${name} `) + String(message.header[name]))
    .join(", ");
}

/** The value of a dotted name, as a person reads it. Empty for a group, whose values follow. */
function valueAt(protocol: Protocol, message: Message, name: string): string {
  let value: unknown = message.fields;
  let fields: Field[] | null = protocol.messages.find((one) => one.name === message.name)?.fields ?? null;
  let field: Field | null = null;
  for (const [, step, index] of name.matchAll(/([^.[\]]+)(?:\[(\d+)\])?/g)) {
    field = fields?.find((one) => one.name === step) ?? null;
    fields = field?.fields ?? null;
    value = (value as Record<string, unknown> | undefined)?.[step!];
    if (index !== undefined) value = (value as unknown[] | undefined)?.[Number(index)];
  }
  if (value instanceof Uint8Array) return hex(value);
  if (value === undefined || (typeof value === "object" && fields)) return "";
  return withUnit(value, field);
}
