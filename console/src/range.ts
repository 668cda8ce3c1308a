// The shown range of a plot and the range that it holds: which one to ask the server for, and the limits of the values.

/** The newest seconds, or a range that does not move by itself. */
export type Range = { seconds: number } | { from: number; to: number };
/** What was asked for: more than is shown, so that a hand that moves the range finds the lines already there. */
export interface Asked {
  from: number;
  to: number;
  times: number; // width, in multiples of the shown range
}

const AROUND = 1; // widths of the range on either side
const ENOUGH = 0.5; // the same: with less left, more is asked for
const CALM = 1.5; // as wide as needed: up to here a scale stays as it is
const ROOM = 0.06; // of the values' range, above and below

/** The range to ask for when `from` to `to` is shown: the last one, while that reaches far enough. */
export function around(from: number, to: number, last: Asked | null): Asked {
  const width = to - from;
  const times = 1 + 2 * AROUND;
  if (
    last &&
    Math.abs((last.to - last.from) / (times * width) - 1) < 1e-6 &&
    from - last.from >= ENOUGH * width * (1 - 1e-6) &&
    last.to - to >= ENOUGH * width * (1 - 1e-6)
  )
    return last;
  return { from: from - AROUND * width, to: to + AROUND * width, times };
}

/** The ends of a scale for values from `low` to `high`; the last ones while they fit, so that the lines do not jump.
 * @param least half of the shown range if all values are equal */
export function calmScale(
  low: number,
  high: number,
  least: number,
  last: readonly [number, number] | null,
): [number, number] {
  if (low > high) return [0, 1];
  const room = (high - low) * ROOM || least;
  const needed = high - low + 2 * room;
  if (last && last[0] <= low && last[1] >= high && last[1] - last[0] <= CALM * needed) return [last[0], last[1]];
  return [low - room, high + room];
}
