import { expect, test } from "vitest";
import { clamp, commands, drivable, valueAt } from "../drive";
import { asPython, bytesOf } from "../frame";
import {
  addressOf,
  ageText,
  clockText,
  digitsOf,
  headerFields,
  initialFields,
  numberText,
  valueText,
  type Field,
  type Message,
  type Protocol,
} from "../protocol";
import { readBatch } from "../views";

const field = (more: Partial<Field>): Field => ({
  name: "linear",
  kind: "number",
  is_integer: false,
  unit: "m/s",
  min: -2,
  max: 2,
  step: 0.001,
  on_range: "clamp",
  default: null,
  values: null,
  description: null,
  count: null,
  max_count: null,
  size: null,
  is_count: false,
  is_time: false,
  fields: null,
  columns: [],
  ...more,
});

test("a number has the digits of its step on the wire, so that columns do not jump", () => {
  expect(digitsOf(0.001)).toBe(3);
  expect(digitsOf(1)).toBe(0);
  expect(numberText(0.5, 0.001)).toBe("0.500");
  expect(numberText(-12345.6, 0.1)).toBe("−12 345.6");
  expect(numberText(null)).toBe("–");
  expect(numberText(3e-7)).toBe("3.000e-7");
});

test("of a group each field stands there once", () => {
  const joints = field({
    name: "joints",
    kind: "struct",
    count: 2,
    fields: [field({ name: "position", unit: "rad", step: 0.01 }), field({ name: "mode", kind: "enum", unit: null })],
  });
  const values = [
    { position: 0.5, mode: "on" },
    { position: -1, mode: "off" },
  ];
  expect(valueText(values, joints)).toBe("position [0.50, −1.00] rad  mode [on, off]");
  expect(valueText([], joints)).toBe("–");
});

test("an age is short", () => {
  expect([0.0123, 0.9999, 12.34, 600].map(ageText)).toEqual(["12 ms", "1.0 s", "12.3 s", "10 min"]);
});

test("a time of day is rounded, not cut", () => {
  const noon = new Date(2026, 10, 22, 12, 0, 0).getTime() / 1000;
  expect([clockText(noon), clockText(noon + 59.9996), clockText(noon + 0.25, 1), clockText(noon - 0.4, 0)]).toEqual([
    "12:00:00.000",
    "12:01:00.000",
    "12:00:00.3",
    "12:00:00",
  ]);
});

test("a form begins at the default, else at what is nearest to zero", () => {
  expect(initialFields([field({ default: 0.5 }), field({ name: "low", min: 3, max: 9 })])).toEqual({
    linear: 0.5,
    low: 3,
  });
  expect(initialFields([field({ name: "n", is_count: true }), field({ name: "list", max_count: 4 })])).toEqual({
    list: [],
  });
});

test("a value out of range is clamped only where the file says so", () => {
  expect(clamp(field({}), 9)).toEqual({ value: 2, clamped: true, outside: false });
  expect(clamp(field({ on_range: "refuse" }), 9)).toEqual({ value: 9, clamped: false, outside: true });
});

test("a pad's position is a part of the range that the reader allows, in steps of the wire", () => {
  const axis = { field: field({}), low: -1, high: 2 };
  expect(valueAt(axis, 1, 0.5)).toBe(1);
  expect(valueAt(axis, -1, 0.5)).toBe(-0.5);
  expect(valueAt(axis, 0.33333, 1)).toBe(0.667);
  expect(valueAt(axis, 7, 1)).toBe(2);
});

test("a pad drives a message that moves, with a range around zero", () => {
  const message = (name: string, is_controlled: boolean, fields: Field[]) =>
    ({ name, is_controlled, fields, sender: "host" }) as unknown as Message;
  const protocol = {
    messages: [
      message("asks", false, [field({})]),
      message("mode", true, [field({ min: 1 })]),
      message("velocity", true, [field({})]),
      message("gripper", true, [field({ name: "opening", unit: "%", min: 0, max: 100 })]),
      message("look", true, [field({ name: "pan", unit: "deg" }), field({ name: "tilt", unit: "deg" })]),
      message("car", true, [field({ name: "speed", unit: "m/s" }), field({ name: "steering", unit: "rad" })]),
      message("boat", true, [field({ name: "rudder", unit: "deg" }), field({ name: "thrust", unit: "%", min: 0 })]),
    ],
    emergency_stop: [],
  } as unknown as Protocol;
  const driven = drivable(protocol).map(({ message, axes }) => [message.name, axes.map((axis) => axis.field.name)]);
  expect(driven).toEqual([
    ["velocity", ["linear"]],
    ["car", ["speed", "steering"]],
  ]);
  expect(commands(protocol).map(({ message }) => message.name)).toEqual(["velocity", "gripper", "look", "car", "boat"]);
});

test("each byte belongs to the deepest part that names it", () => {
  const part = (name: string, level: number, offset: number, wire: string) =>
    ({ name, level, offset, wire, data: wire, meaning: "", state: "named" }) as const;
  const rows = [part("magic", 0, 0, "aa55"), part("payload", 0, 2, "0102"), part("linear", 1, 2, "01")];
  const stretch = {
    kind: "frame",
    offset: 0,
    wire: "aa550102",
    cause: "",
    summary: "",
    rows,
    rules: [],
    guesses: [],
  } as const;
  const { bytes, parts } = bytesOf({ stretches: [{ ...stretch, rows: [...rows], rules: [], guesses: [] }] });
  expect(bytes.map((byte) => `${byte.hex} ${parts[byte.part]?.name}`)).toEqual([
    "AA magic",
    "55 magic",
    "01 linear",
    "02 payload",
  ]);
});

test("a message is copied as a call in Python", () => {
  expect(asPython("parameter", { name: "max_linear", value: 1.5, on: true, list: [1, null] })).toBe(
    'link.send("parameter", name="max_linear", value=1.5, on=True, list=[1, None])',
  );
});

test("a batch of a plot is read in place, arrays at multiples of 8 bytes", () => {
  const columns = [
    { field: "a.x", n: 3, t: "f64", low: "f32", high: "f32" },
    { field: "a.y", n: 1, t: "f64", low: "f64", high: "f64" },
  ];
  let head = JSON.stringify({ plot: "p1", now: 5, from: 0, to: 5, replace: true, columns });
  while ((4 + head.length) % 8) head += " ";
  const data = new ArrayBuffer(4 + head.length + 24 + 16 + 16 + 8 + 8 + 8);
  new DataView(data).setUint32(0, head.length, true);
  new Uint8Array(data).set(new TextEncoder().encode(head), 4);
  const at = 4 + head.length;
  new Float64Array(data, at, 3).set([1, 2, 3]);
  new Float32Array(data, at + 24, 3).set([4, NaN, 6]);
  new Float64Array(data, at + 56, 3).set([7, 8, 9]);
  const batch = readBatch(data);
  expect([...batch.columns[0]!.low]).toEqual([4, NaN, 6]);
  expect([batch.columns[1]!.t[0], batch.columns[1]!.low[0], batch.columns[1]!.high[0]]).toEqual([7, 8, 9]);
});

test("a command says whom it is for, as a number; what the link counts or is itself is not asked for", () => {
  const header = [
    { ...field({ name: "servo", default: 1 }), is_sequence: false, address: "mcu" },
    { ...field({ name: "from", default: 9 }), is_sequence: false, address: "sender" },
    { ...field({ name: "number", default: 0 }), is_sequence: true, address: null },
  ];
  const bus = { header } as unknown as Protocol;
  expect(headerFields(bus).map((one) => one.name)).toEqual(["servo"]);
  expect(addressOf(bus, { servo: 3 })).toBe(3);
  expect(addressOf(bus, {})).toBe(1);
  expect(addressOf({ header: [] } as unknown as Protocol, {})).toBeUndefined();
});
