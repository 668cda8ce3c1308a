// Which message a velocity pad drives, by which fields, and the values of a position of the pad. It sends nothing.
import type { Field, Message, Protocol } from "./protocol";

export interface Axis {
  field: Field;
  low: number;
  high: number;
}
export interface Drive {
  message: Message;
  axes: Axis[]; // forward, then turn
}

/** Fields that a pad can move: one number whose range holds zero, so that letting go is a value. */
export function axesOf(message: Message): Axis[] {
  return message.fields
    .filter((field) => field.kind === "number" && field.count === null && field.max_count === null && !field.is_count)
    .flatMap((field) =>
      field.min !== null && field.max !== null && field.min <= 0 && field.max > 0
        ? [{ field, low: field.min, high: field.max }]
        : [],
    );
}

// Letting go of a pad sends zero, which ends a movement. Of an angle or a place, zero is one more place to go to.
const PLACES = new Set(["rad", "mrad", "deg", "°", "m", "cm", "mm"]);
const isTwoSided = ({ low }: Axis) => low < 0;
const moves = ({ field }: Axis) => !PLACES.has(field.unit ?? "");

/** Messages that a pad can drive: with a speed or the like, forward and back. */
export const drivable = (protocol: Protocol): Drive[] =>
  commands(protocol)
    .map(({ message, axes }) => ({ message, axes: axes.filter(isTwoSided) }))
    .filter(({ axes }) => axes.some(moves));

/** Messages that move the robot, with a number that can be set to zero; those of the emergency stop first. */
export function commands(protocol: Protocol): Drive[] {
  const stops = new Set(protocol.emergency_stop.map((stop) => stop.message));
  return protocol.messages
    .filter((message) => message.sender !== "mcu" && message.is_controlled)
    .map((message) => ({ message, axes: axesOf(message) }))
    .filter(({ axes }) => axes.length > 0)
    .sort((a, b) => Number(stops.has(b.message.name)) - Number(stops.has(a.message.name)));
}

/** The value of an axis at `position` (-1 to 1), where the reader allows `limit` (0 to 1) of the range. In steps of the wire. */
export function valueAt(axis: Axis, position: number, limit: number): number {
  const side = position < 0 ? -axis.low : axis.high;
  const value = Math.max(-1, Math.min(1, position)) * limit * side;
  const step = axis.field.step;
  if (step === null || step <= 0) return value;
  return Number((Math.round(value / step) * step).toFixed(9));
}

/** What is sent of a wanted value: within the range where the file says `clamp`. `clamped`: it was changed.
 *  `outside`: the file does not clamp, and refuses it. */
export function clamp(field: Field, wanted: number): { value: number; clamped: boolean; outside: boolean } {
  const value = Math.min(Math.max(wanted, field.min ?? -Infinity), field.max ?? Infinity);
  const differs = value !== wanted;
  return {
    value: differs && field.on_range !== "clamp" ? wanted : value,
    clamped: differs && field.on_range === "clamp",
    outside: differs && field.on_range !== "clamp",
  };
}
