// What of a protocol can be tuned: its parameter service, and messages that set numbers. It sends nothing.
import { commands } from "./drive";
import { columnsOf, type Field, type Message, type Protocol } from "./protocol";

export interface Parameter {
  key: string; // unique within the source
  label: string;
  field: Field; // of the value
  selector: Record<string, unknown>; // fields that say which one: {index: "kp"}
}
export interface Source {
  name: string; // of the message; of the service `parameter`
  isService: boolean;
  set: Message;
  read: Message | null; // asks for the current value
  value: Message | null; // has the current value
  selectors: Field[]; // numbers that the reader chooses, such as the index of a loop
  parameters: Parameter[];
}

const isPlain = (field: Field) => field.count === null && field.max_count === null && !field.is_count;
const isValue = (field: Field) =>
  field.kind === "number" && isPlain(field) && (!field.is_integer || Boolean(field.unit));

/** Does this end a deadline, so that it is not a parameter, although it is sent as one? */
const isCommand = (protocol: Protocol, message: string, selector: Record<string, unknown>) =>
  protocol.deadlines.some(
    ({ recover_by: by }) =>
      by?.message === message && Object.entries(selector).every(([name, value]) => by.fields[name] === value),
  );

export function sourcesOf(protocol: Protocol): Source[] {
  const sources: Source[] = [];
  const find = (name: string | null) => protocol.messages.find((message) => message.name === name) ?? null;
  const service = protocol.parameters;
  const set = find(service?.set ?? null);
  if (service && set) {
    const names = Object.keys(service.names);
    const parameters = names.map((name) => ({
      key: name,
      label: name,
      field: service.field,
      selector: { index: name },
    }));
    sources.push({
      name: "parameter",
      isService: true,
      set,
      read: find(service.read),
      value: find(service.value),
      selectors: [],
      parameters,
    });
  }
  const ofServices = new Set(protocol.services.flatMap((one) => Object.values(one.messages)));
  for (const message of protocol.messages) {
    if (message.sender === "mcu" || message.is_controlled || message.every !== null || ofServices.has(message.name))
      continue;
    const values = message.fields.filter(isValue);
    const named = message.fields.filter((field) => field.kind === "enum" && isPlain(field));
    const selectors = message.fields.filter(
      (field) => field.kind === "number" && field.is_integer && isPlain(field) && !field.unit && field.default === null,
    );
    if (values.length === 0) continue;
    const has = (other: Message | null) =>
      other !== null && values.every((value) => other.fields.some((field) => field.name === value.name));
    const own = new Set(message.fields.map((field) => field.name));
    const read =
      protocol.messages.find(
        (one) =>
          one.sender !== "mcu" &&
          one !== message &&
          has(find(one.reply)) &&
          one.fields.every((field) => own.has(field.name)),
      ) ?? null;
    const value = read ? find(read.reply) : has(find(message.reply)) ? find(message.reply) : null;
    const parameters =
      named.length === 1 && values.length === 1
        ? Object.keys(named[0]!.values ?? {})
            .filter((name) => !isCommand(protocol, message.name, { [named[0]!.name]: name }))
            .map((name) => ({
              key: name,
              label: name,
              field: values[0]!,
              selector: { [named[0]!.name]: name },
            }))
        : values.map((field) => ({ key: field.name, label: field.name, field, selector: {} }));
    sources.push({ name: message.name, isService: false, set: message, read, value, selectors, parameters });
  }
  return sources.sort((a, b) => rank(a) - rank(b));
}
const rank = (source: Source) => (source.isService ? 0 : source.read ? 1 : source.set.reply ? 2 : 3);

/** Columns that show what a change does, until the reader chooses: the robot's first regular fields of one unit, which is
 *  that of what is driven where it reports such a field. */
export function answering(protocol: Protocol): string[] {
  const all = columnsOf(protocol).filter(
    ({ field, message }) =>
      message.sender === "mcu" && message.every !== null && field.kind === "number" && !field.is_time,
  );
  const driven = commands(protocol).flatMap((drive) => drive.axes.map((axis) => axis.field.unit));
  const first = all.find(({ field }) => field.unit && driven.includes(field.unit)) ?? all[0];
  return all
    .filter(({ field }) => field.unit === first?.field.unit)
    .map(({ column }) => column)
    .slice(0, 2);
}

/** Whether the robot has the wanted value. Numbers lose digits on the wire: within a step, or a float's digits. */
export function isSame(wanted: number, inForce: number, step: number | null): boolean {
  return (
    Math.abs(wanted - inForce) <= Math.max((step ?? 0) * 0.51, 1e-6 * Math.max(Math.abs(wanted), Math.abs(inForce)))
  );
}

/** Why a reply refuses; null: it does not. A field `result` says so by an enum whose 0 is consent. */
export function refusal(reply: Record<string, unknown>, message: Message | null): string | null {
  const field = message?.fields.find((one) => one.name === "result" && one.kind === "enum");
  const result = reply.result;
  if (!field || result === undefined) return null;
  const number = typeof result === "string" ? field.values?.[result] : result;
  return number === 0 ? null : String(result);
}

/** Values of a file that this page has exported, or that Python's `link.parameters.save` has written, as YAML or JSON.
 *  Throws with the line that is none. */
export function readValues(text: string): Record<string, number> {
  const values: Record<string, number> = {};
  const lines = text.trimStart().startsWith("{")
    ? Object.entries(JSON.parse(text) as Record<string, unknown>).map(([name, value]) => `${name}: ${String(value)}`)
    : text.split(/\r?\n/);
  for (const line of lines) {
    const found = /^([^\s#:][^:]*):\s+(\S+)\s*(?:#.*)?$/.exec(line);
    const value = Number(found?.[2] ?? NaN);
    if (found && Number.isFinite(value)) values[found[1]!.trim()] = value;
    else if (!/^\s*(#.*)?$/.test(line)) throw new Error(line.trim().slice(0, 80));
  }
  return values;
}

export function asYaml(values: Record<string, number>): string {
  return Object.entries(values)
    .map(([name, value]) => `${name}: ${value}\n`)
    .join("");
}

export function asCpp(values: Record<string, number>, space: string): string {
  const word = (name: string) => name.replace(/\W/g, "_").replace(/^(\d)/, "_$1");
  const lines = Object.entries(values).map(([name, value]) => {
    const text = String(value);
    return `inline constexpr float ${word(name)} = ${/[.e]/.test(text) ? text : `${text}.0`}F;`;
  });
  return `#pragma once\n\nnamespace ${word(space)} {\n\n${lines.join("\n")}\n\n}  // namespace ${word(space)}\n`;
}
