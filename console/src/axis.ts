// The numbers on an axis of values, and their width.
import { numberText } from "./protocol";

const MOST_DIGITS = 6; // after the point
const MOST = 1e15; // from here on a number has more digits than a float knows
const LEAST_ROOM = 64; // px: most numbers fit, so that plots over each other have the same left edge
const ROOM_STEP = 16; // px: a plot does not change its width with each digit
export const TICK = 4; // px, and so is the gap between the tick and its number
const MARGIN = 3 * TICK;

/** Number of digits after the point that show this step exactly: 0.0025 has four. */
function digitsOfStep(step: number): number {
  const least = Math.max(0, Math.ceil(-Math.log10(step) - 1e-9));
  return Math.abs(step * 10 ** least - Math.round(step * 10 ** least)) < 1e-6 ? least : least + 1;
}

/** With as many digits as show that neighbours are equally far apart. */
export function valueTicks(splits: readonly number[]): string[] {
  const step = splits.length > 1 ? Math.abs(splits[1]! - splits[0]!) : 1;
  const digits = digitsOfStep(step);
  const greatest = Math.max(...splits.map(Math.abs));
  if (digits <= MOST_DIGITS && greatest < MOST) return splits.map((value) => numberText(value, 10 ** -digits));
  const places = Math.min(15, Math.max(0, Math.floor(Math.log10(greatest)) - Math.floor(Math.log10(step))));
  return splits.map((value) => (Math.abs(value) < step / 2 ? "0" : exponential(value, places)));
}

const exponential = (value: number, places: number) =>
  `${value < 0 ? "−" : ""}${Math.abs(value).toExponential(places)}`.replace("e-", "e−");

/** The width of an axis with these numbers.
 *  @param measure the width of a text in px */
export function roomFor(texts: readonly string[], measure: (text: string) => number): number {
  const widest = Math.max(0, ...texts.map(measure));
  const more = widest + MARGIN - LEAST_ROOM;
  return more <= 0 ? LEAST_ROOM : LEAST_ROOM + Math.ceil(more / ROOM_STEP) * ROOM_STEP;
}
