// What a plot holds of its columns: the rows of its batches, in which range, and how wide a pixel of them is.
import { Series } from "./series";
import type { Batch } from "./views";

/** Widths of pixels that are the same may differ in their last digits. */
export const SAME = 1 + 1e-6;
const NONE = { from: Infinity, to: -Infinity };

export class Rows {
  readonly series = new Map<string, Series>();
  from = 0;
  to = 0;
  width = 0; // seconds of a pixel

  /** Takes a batch. Returns between which times the rows are those that were there before. */
  take(batch: Batch): { from: number; to: number } {
    // Batches of one width have the same pixels, but for those at an end of a range, and those of another source.
    const from = Math.max(this.from, batch.from) + batch.width;
    const to = Math.min(this.to, batch.to) - batch.width;
    let isSame = Math.max(batch.width, this.width) < SAME * Math.min(batch.width, this.width);
    let known = Infinity;
    for (const column of batch.columns) {
      let one = this.series.get(column.field);
      if (!one) this.series.set(column.field, (one = new Series()));
      isSame &&= !batch.replace || one.agrees(column, from, Math.min(one.lastTime() - batch.width, to));
      known = Math.min(known, one.take(column, batch.replace, batch.from));
    }
    if (batch.replace) isSame = this.dropOthers(batch) && isSame;
    [this.from, this.to, this.width] = [batch.from, batch.to, batch.width];
    if (!isSame) return NONE;
    return batch.replace ? { from, to: Math.min(known - batch.width, to) } : { from: -Infinity, to: known };
  }

  /** Forgets rows that the batch does not have. Returns whether there were any. */
  private dropOthers(batch: Batch): boolean {
    let isSame = true;
    for (const [name, one] of this.series) {
      if (batch.columns.some((column) => column.field === name)) continue;
      isSame &&= one.end === one.start;
      this.series.delete(name);
    }
    return isSame;
  }
}
