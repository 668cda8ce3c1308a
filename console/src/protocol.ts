// The server's description of a protocol file, and functions of it for every view. docs/console-api.md has the shapes.

export interface Field {
  name: string;
  kind: "number" | "bool" | "enum" | "flags" | "text" | "bytes" | "struct";
  is_integer: boolean;
  unit: string | null;
  min: number | null;
  max: number | null;
  step: number | null;
  on_range: string | null;
  default: unknown;
  values: Record<string, number> | null;
  description: string | null;
  count: number | null;
  max_count: number | null;
  size: number | null;
  is_count: boolean;
  is_time: boolean; // when the values of its message were measured
  fields: Field[] | null;
  columns: string[];
}
/** A field of the frame itself, beside the message. */
export interface HeaderField extends Field {
  is_sequence: boolean;
  address: string | null; // whose it is: `mcu` or `receiver` is who a frame of the host is for
}
export type Header = Record<string, unknown>;
export interface Message {
  name: string;
  id: number | null;
  sender: "host" | "mcu" | "both";
  every: number | null;
  reply: string | null;
  is_controlled: boolean;
  description: string | null;
  log: unknown;
  bytes: number;
  fields: Field[];
}
/** A message with the values that the file gives it. */
export interface GivenMessage {
  message: string;
  fields: Record<string, unknown>;
  header: Record<string, unknown>;
}
export interface Protocol {
  name: string;
  hash: string;
  description: string | null;
  text: string;
  path: string | null;
  link: {
    baud: number;
    data_bits: number;
    parity: string;
    stop_bits: number;
    bits_per_byte: number;
    port: string | null;
  };
  messages: Message[];
  header: HeaderField[];
  emergency_stop: GivenMessage[];
  deadlines: {
    message: string;
    at: string;
    after: number;
    then: string;
    recover: string;
    recover_by: GivenMessage | null;
  }[];
  services: { name: string; messages: Record<string, string> }[];
  parameters: null | { names: Record<string, number>; field: Field; read: string; set: string; value: string };
}

/** Everything of the protocol that can be plotted, in the file's order. */
export function columnsOf(protocol: Protocol): { column: string; field: Field; message: Message }[] {
  const found: { column: string; field: Field; message: Message }[] = [];
  const walk = (message: Message, fields: Field[]) => {
    for (const field of fields) {
      for (const column of field.columns) found.push({ column, field, message });
      if (field.fields) walk(message, field.fields);
    }
  };
  for (const message of protocol.messages) walk(message, message.fields);
  return found;
}

/** By message: each field that can be plotted, with its columns: `state.joints.position` with one of each joint. */
export function wholeFields(table: ReadonlyMap<string, Field>): [string, { path: string; columns: string[] }[]][] {
  const messages = new Map<string, Map<string, string[]>>();
  for (const column of table.keys()) {
    const message = column.split(".", 1)[0]!;
    const path = column.replace(/\[\d+\]/g, "");
    const fields = messages.get(message) ?? new Map<string, string[]>();
    messages.set(message, fields.set(path, [...(fields.get(path) ?? []), column]));
  }
  return [...messages].map(([message, fields]) => [message, [...fields].map(([path, columns]) => ({ path, columns }))]);
}

/** What a form begins with: the default, else the value nearest to zero that is allowed. */
export function initialValue(field: Field): unknown {
  if (field.default !== null && field.default !== undefined) return field.default;
  if (field.count !== null) return Array.from({ length: field.count }, () => initialOne(field));
  if (field.max_count !== null) return [];
  return initialOne(field);
}

function initialOne(field: Field): unknown {
  switch (field.kind) {
    case "number":
      return Math.min(Math.max(0, field.min ?? 0), field.max ?? Infinity);
    case "bool":
      return false;
    case "enum":
      return Object.keys(field.values ?? {})[0] ?? 0;
    case "flags":
      return [];
    case "struct":
      return initialFields(field.fields ?? []);
    default:
      return "";
  }
}

export function initialFields(fields: Field[]): Record<string, unknown> {
  return Object.fromEntries(
    fields.filter((field) => !field.is_count).map((field) => [field.name, initialValue(field)]),
  );
}

/** Fields of the frame that a command may set. Numbers that the link counts, and its own address, are none. */
export const headerFields = (protocol: Protocol | null) =>
  protocol?.header.filter((field) => !field.is_sequence && field.address !== "sender") ?? [];

/** The address that a frame of the host with this header is for, as a number; undefined: frames have none. */
export function addressOf(protocol: Protocol | null, header: Header): number | undefined {
  const field = protocol?.header.find((one) => one.address === "mcu" || one.address === "receiver");
  const value = field && (header[field.name] ?? field.default);
  return typeof value === "string" ? field?.values?.[value] : typeof value === "number" ? value : undefined;
}

/** Digits after the point that show one step of the wire, at most 6. */
export function digitsOf(step: number | null): number | null {
  if (step === null || !(step > 0)) return null;
  for (let digits = 0; digits <= 6; digits++) {
    const scaled = step * 10 ** digits;
    if (Math.abs(scaled - Math.round(scaled)) < 1e-6 * Math.max(1, scaled)) return digits;
  }
  return 6;
}

const MINUS = "−";
const THIN = " "; // between groups of thousands

/** A number for reading: fixed digits where the wire has a step, so that columns do not jump. */
export function numberText(value: unknown, step: number | null = null): string {
  if (value === null || value === undefined) return "–";
  if (typeof value === "bigint") return value.toString();
  if (typeof value !== "number") return String(value);
  if (!Number.isFinite(value)) return String(value);
  const digits = digitsOf(step);
  const size = Math.abs(value);
  let text: string;
  if (digits !== null) text = size.toFixed(digits);
  else if (Number.isInteger(size) && size < 1e7) text = String(size);
  else if (size >= 1e7 || size < 1e-4) text = size.toExponential(3);
  else text = size.toPrecision(size >= 1e4 ? 6 : 5);
  return (value < 0 ? MINUS : "") + grouped(text);
}

export function grouped(text: string): string {
  const [whole = "", rest] = text.split(".", 2);
  if (whole.length < 5 || text.includes("e")) return text;
  const groups = whole.replace(/\B(?=(\d{3})+$)/g, THIN);
  return rest === undefined ? groups : `${groups}.${rest}`;
}

/** Any value of a message as one line: flags as names, structs, lists and groups in short. */
export function valueText(value: unknown, field: Field | null): string {
  if (value === null || value === undefined) return "–";
  if (field?.kind === "struct" && field.fields && !Array.isArray(value) && typeof value === "object") {
    const inner = value as Record<string, unknown>;
    return field.fields.map((one) => `${one.name} ${withUnit(inner[one.name], one)}`).join("  ");
  }
  if (Array.isArray(value)) {
    if (value.length === 0) return "–";
    if (field?.kind === "flags" && field.count === null && field.max_count === null) return value.join(", ");
    if (field?.kind === "struct" && field.fields) return fieldByField(value as Record<string, unknown>[], field.fields);
    return `[${value.map((one) => valueText(one, field)).join(", ")}]`;
  }
  if (typeof value === "number") return numberText(value, field?.step ?? null);
  if (typeof value === "boolean") return value ? "true" : "false";
  if (typeof value === "object") return JSON.stringify(value);
  return String(value);
}

/** Of a group: each field once, with its values of all elements. */
function fieldByField(elements: Record<string, unknown>[], fields: Field[]): string {
  return fields
    .map(
      (one) =>
        `${one.name} ${withUnit(
          elements.map((element) => element[one.name]),
          one,
        )}`,
    )
    .join("  ");
}

export function withUnit(value: unknown, field: Field | null): string {
  const unit = field?.unit && value !== null && value !== undefined ? ` ${field.unit}` : "";
  return valueText(value, field) + unit;
}

/** A length of time in few characters: 340 ms, 12.3 s, 4 min. */
export function ageText(seconds: number): string {
  if (seconds < 0.9995) return `${Math.max(0, Math.round(seconds * 1000))} ms`;
  if (seconds < 99.95) return `${seconds.toFixed(1)} s`;
  if (seconds < 5400) return `${Math.round(seconds / 60)} min`;
  return `${(seconds / 3600).toFixed(1)} h`;
}

/** A time of day, of seconds since 1970: 14:05:09.120. */
export function clockText(wall: number, digits = 3): string {
  const unit = 10 ** digits;
  const at = new Date(Math.round((Math.round(wall * unit) / unit) * 1000));
  const [hours, minutes, seconds] = [at.getHours(), at.getMinutes(), at.getSeconds()].map((n) =>
    `${n}`.padStart(2, "0"),
  );
  const part = digits === 0 ? "" : `.${`${at.getMilliseconds()}`.padStart(3, "0").slice(0, digits)}`;
  return `${hours}:${minutes}:${seconds}${part}`;
}

export function sizeText(bytes: number): string {
  if (bytes < 1000) return `${bytes} B`;
  if (bytes < 1e6) return `${(bytes / 1e3).toFixed(1)} kB`;
  if (bytes < 1e9) return `${(bytes / 1e6).toFixed(1)} MB`;
  return `${(bytes / 1e9).toFixed(2)} GB`;
}

export const percentText = (share: number) => `${(100 * share).toFixed(share < 0.0995 ? 1 : 0)} %`;

/** `aa55…` as `AA 55 …`. */
export const hexText = (hex: string) => (hex.match(/../g) ?? []).join(" ").toUpperCase();
