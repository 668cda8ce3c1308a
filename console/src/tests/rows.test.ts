import { beforeEach, expect, test } from "vitest";
import { Rows } from "../rows";
import type { Batch } from "../views";

const WIDTH = 1;
let rows: Rows;
const NOTHING = { from: Infinity, to: -Infinity };
/** A row each second from `from` to `to`, whose value is its time and more. */
function batch(from: number, to: number, more = 0, field = "a.x", replace = true): Batch {
  const t = Float64Array.from({ length: to - from + 1 }, (_, n) => from + n);
  const low = t.map((at) => at + more);
  return { plot: "p", now: to, from, to, width: WIDTH, replace, columns: [{ field, t, low, high: low }] };
}

beforeEach(() => {
  rows = new Rows();
  rows.take(batch(0, 30));
});

test("where two ranges overlap the rows stay, but for the pixels at the ends", () => {
  expect(rows.take(batch(10, 40))).toEqual({ from: 11, to: 29 });
  expect([rows.from, rows.to]).toEqual([10, 40]);
});

test("new rows leave those before them", () => {
  expect(rows.take(batch(30, 32, 0, "a.x", false))).toEqual({ from: -Infinity, to: 29 });
});

test("nothing stays of another source, another width, or a column that is gone", () => {
  expect(rows.take(batch(0, 30, 0.5))).toEqual(NOTHING);
  expect(rows.take({ ...batch(0, 30, 0.5), width: 2 })).toEqual(NOTHING);
  expect(rows.take(batch(0, 30, 0, "a.y"))).toEqual(NOTHING);
  expect([...rows.series.keys()]).toEqual(["a.y"]);
});
