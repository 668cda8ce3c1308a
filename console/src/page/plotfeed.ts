// Batches of one plot: only rows that are new since the last one. docs/console-api.md, "Plots", has the bytes.
import type { PlotWish } from "../views";
import type { History, Pixels } from "./history";
import { placeOf } from "./history";

interface Sent {
  begin: number; // of the first pixel that may still change
  rows: string; // those from there on
}
const ALIGNED = 8;

export class PlotFeed {
  private readonly sent = new Map<string, Sent>(); // by field
  private isFirst = true;
  private newest = -Infinity; // newest time of a fixed range when it was last read

  constructor(readonly plot: PlotWish) {}

  /** What the page lacks; null: nothing. */
  batch(history: History, now: number): ArrayBuffer | null {
    const { seconds, from = 0, to = 0 } = this.plot;
    if (seconds !== undefined) return this.between(history, now, now - seconds, now, seconds / this.plot.pixels);
    const newest = Math.min(history.range()?.[1] ?? -Infinity, to);
    if (newest === this.newest && !this.isFirst) return null;
    this.newest = newest;
    return this.between(history, now, from, to, (to - from) / this.plot.pixels);
  }

  private between(history: History, now: number, begin: number, end: number, width: number): ArrayBuffer | null {
    const columns: { field: string; pixels: Pixels }[] = [];
    for (const field of this.plot.fields) {
      const sent = this.sent.get(field);
      const { track, column } = history.find(field);
      const pixels = track.pixels(column, sent?.begin ?? begin, end, width, history.breaks);
      if (pixels.t.length === 0 || (sent && rowsFrom(pixels, pixels.t[0]!) === sent.rows)) continue;
      const open = Math.max(Math.floor(pixels.open / width) * width, begin);
      this.sent.set(field, { begin: open, rows: rowsFrom(pixels, pixels.open) });
      columns.push({ field, pixels });
    }
    const isFirst = this.isFirst;
    this.isFirst = false;
    if (columns.length === 0 && !isFirst) return null;
    return packed({ plot: this.plot.id, now, from: begin, to: end, width, replace: isFirst }, columns);
  }
}

function rowsFrom(pixels: Pixels, t: number): string {
  const place = placeOf(pixels.t, pixels.t.length, t);
  return [pixels.t, pixels.low, pixels.high].map((rows) => rows.slice(place).join()).join(";");
}

function packed(head: Record<string, unknown>, columns: { field: string; pixels: Pixels }[]): ArrayBuffer {
  const told = columns.map(({ field, pixels }) => ({ field, n: pixels.t.length, t: "f64", low: "f64", high: "f64" }));
  const text = new TextEncoder().encode(JSON.stringify({ ...head, columns: told }));
  const padded = Math.ceil((text.length + 4) / ALIGNED) * ALIGNED - 4;
  const rows = columns.reduce((sum, { pixels }) => sum + 3 * pixels.t.length, 0);
  const out = new Uint8Array(4 + padded + 8 * rows);
  new DataView(out.buffer).setUint32(0, padded, true);
  out.fill(32, 4, 4 + padded);
  out.set(text, 4);
  let at = 4 + padded;
  for (const { pixels } of columns) {
    for (const values of [pixels.t, pixels.low, pixels.high]) {
      new Float64Array(out.buffer, at, values.length).set(values);
      at += 8 * values.length;
    }
  }
  return out.buffer;
}
