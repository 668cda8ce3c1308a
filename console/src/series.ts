// The rows of one column of a plot that the page holds: least and greatest by pixel. Appends in place; forgets the old.
import type { Column } from "./views";

const FIRST = 1024; // rows

export class Series {
  t = new Float64Array(FIRST);
  low = new Float64Array(FIRST);
  high = new Float64Array(FIRST);
  start = 0;
  end = 0;

  /** What a batch brings. With `replace` these rows are all; else rows at or behind the first new one go before.
   *  Returns up to which time rows stay as they were; with `replace` up to which there were any. */
  take(column: Column, replace: boolean, from: number): number {
    let same = this.lastTime();
    if (replace) this.start = this.end = 0;
    const count = column.t.length;
    const first = firstTime(column.t);
    if (first !== null) while (this.end > this.start && !(this.t[this.end - 1]! < first)) this.end--;
    if (!replace) same = this.lastTime();
    while (this.start < this.end && !(this.t[this.start]! >= from)) this.start++;
    if (this.start > 0 && this.t[this.start - 1]! < from) this.start--; // the line goes on to the left edge
    this.makeRoom(count);
    this.t.set(column.t, this.end);
    this.low.set(column.low, this.end);
    this.high.set(column.high, this.end);
    this.end += count;
    return same;
  }

  /** Are the rows from `from` to `to` those of this column? */
  agrees(column: Column, from: number, to: number): boolean {
    const isMeant = (t: number) => t >= from && t <= to;
    let mine = this.start;
    const skip = () => {
      while (mine < this.end && !isMeant(this.t[mine]!)) mine++;
    };
    for (let i = 0; i < column.t.length; i++) {
      if (!isMeant(column.t[i]!)) continue;
      skip();
      if (mine === this.end) return false;
      for (const name of ["t", "low", "high"] as const) if (!Object.is(this[name][mine], column[name][i])) return false;
      mine++;
    }
    skip();
    return mine === this.end;
  }

  /** Least and greatest of the rows from `from` to `to`; null: there are none. */
  range(from: number, to: number): [number, number] | null {
    let low = Infinity;
    let high = -Infinity;
    for (let i = this.before(from); i < this.end && !(this.t[i]! > to); i++) {
      if (this.t[i]! < from) continue;
      if (this.low[i]! < low) low = this.low[i]!;
      if (this.high[i]! > high) high = this.high[i]!;
    }
    return low <= high ? [low, high] : null;
  }

  /** Index of the newest row at or before `t`; -1: there is none, or a gap is there. */
  at(t: number): number {
    const index = this.countTo(t) - 1;
    return index >= this.start && !Number.isNaN(this.low[index]!) ? index : -1;
  }

  /** Least and greatest of the rows that begin behind `from` and up to `to`; where none does, of the row that holds
   *  there; null: a gap is there. */
  within(from: number, to: number): [number, number] | null {
    let row = this.countTo(from);
    const end = this.countTo(to);
    if (row >= end) row = this.at(to);
    if (row < 0) return null;
    let found: [number, number] | null = null;
    do {
      const [low, high] = [this.low[row]!, this.high[row]!];
      if (!Number.isNaN(low)) found = [Math.min(low, found?.[0] ?? low), Math.max(high, found?.[1] ?? high)];
    } while (++row < end);
    return found;
  }

  /** The row that a line comes from at `t`: the newest at or before it, else the first. */
  before(t: number): number {
    return Math.max(this.start, this.countTo(t) - 1);
  }

  /** The end of the rows that a line needs up to `t`: the last one is at or after it. */
  behind(t: number): number {
    return Math.min(this.end, this.countTo(t) + 1);
  }

  /** The newest row up to `until` that has a value; -1: none. */
  last(until = Infinity): number {
    for (let i = this.countTo(until) - 1; i >= this.start; i--) if (!Number.isNaN(this.low[i]!)) return i;
    return -1;
  }

  /** Of the newest row. */
  lastTime(): number {
    return this.end > this.start ? this.timeNear(this.end - 1) : -Infinity;
  }

  /** The end of the rows at or before `t`. */
  private countTo(t: number): number {
    let low = this.start;
    let high = this.end;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.timeNear(middle) <= t) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** The time of a row; of the row of a gap that has none, that of the row before. */
  private timeNear(index: number): number {
    for (let i = index; i >= this.start; i--) if (!Number.isNaN(this.t[i]!)) return this.t[i]!;
    return -Infinity;
  }

  private makeRoom(count: number): void {
    const kept = this.end - this.start;
    if (this.end + count <= this.t.length) return;
    const capacity = Math.max(this.t.length, 2 * (kept + count));
    for (const name of ["t", "low", "high"] as const) {
      const old = this[name];
      if (capacity === old.length) {
        old.copyWithin(0, this.start, this.end);
        continue;
      }
      this[name] = new Float64Array(capacity);
      this[name].set(old.subarray(this.start, this.end));
    }
    this.start = 0;
    this.end = kept;
  }
}

function firstTime(times: Float64Array): number | null {
  for (const t of times) if (!Number.isNaN(t)) return t;
  return null;
}
