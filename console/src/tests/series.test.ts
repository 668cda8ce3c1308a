import { expect, test } from "vitest";
import { Series } from "../series";
import type { Column } from "../views";

const column = (t: number[], low: number[], high = low): Column => ({
  field: "a.x",
  t: Float64Array.from(t),
  low: Float64Array.from(low),
  high: Float64Array.from(high),
});

test("new rows replace those at or behind the first of them, as the last pixel was not whole", () => {
  const series = new Series();
  series.take(column([1, 2, 3], [10, 20, 30]), true, 0);
  series.take(column([3, 4], [31, 40], [35, 40]), false, 0);
  expect([...series.t.subarray(series.start, series.end)]).toEqual([1, 2, 3, 4]);
  expect(series.high[2]).toBe(35);
});

test("what lies before the range is forgotten, but for one row that the line comes from", () => {
  const series = new Series();
  for (let t = 0; t < 10_000; t++) series.take(column([t], [t]), t === 0, t - 100);
  expect(series.end - series.start).toBeLessThanOrEqual(102);
  expect(series.t.length).toBeLessThan(4096);
  expect(series.range(9950, 9999)).toEqual([9950, 9999]);
});

test("a gap has no value, neither under the cursor nor in the range", () => {
  const series = new Series();
  series.take(column([1, 1.5, 5], [10, NaN, 50]), true, 0);
  expect(series.low[series.at(1.2)]).toBe(10);
  expect(series.at(3)).toBe(-1);
  expect(series.at(0.5)).toBe(-1);
  expect(series.low[series.at(9)]).toBe(50);
  expect(series.range(0, 9)).toEqual([10, 50]);
});

test("a pixel has the values of all rows that begin in it, and else those that hold there", () => {
  const series = new Series();
  series.take(column([1, 2, 3, 3.5, 5], [10, -20, 30, NaN, 50], [11, 21, 31, NaN, 51]), true, 0);
  expect(series.within(0.5, 2.5)).toEqual([-20, 21]);
  expect(series.within(1, 2)).toEqual([-20, 21]); // what begins at its left edge is of the pixel before
  expect(series.within(2.1, 2.2)).toEqual([-20, 21]);
  expect(series.within(2.9, 3.6)).toEqual([30, 31]);
  expect(series.within(3.6, 4)).toBeNull();
  expect(series.within(0, 0.5)).toBeNull();
  expect(series.within(6, 7)).toEqual([50, 51]);
});

test("a batch tells up to which time the rows stay as they were", () => {
  const series = new Series();
  expect(series.take(column([1, 2, 3], [10, 20, 30]), true, 0)).toBe(-Infinity);
  expect(series.take(column([3, 4], [31, 40]), false, 0)).toBe(2);
  expect(series.take(column([], []), false, 0)).toBe(4);
  expect(series.take(column([1, 2, 3, 4, 5], [10, 20, 31, 41, 50]), true, 0)).toBe(4);
});

test("a line comes from the row before its left edge and goes to the row behind its right edge", () => {
  const series = new Series();
  series.take(column([1, 2, 3, 4, 5], [1, 2, 3, 4, 5]), true, 0);
  expect([series.before(2.5), series.behind(3.5)]).toEqual([1, 4]);
  expect([series.before(0), series.behind(9)]).toEqual([0, 5]);
  expect(series.last(3.5)).toBe(2);
});

test("rows agree with a column where both have the same times and values", () => {
  const series = new Series();
  series.take(column([1, 2, 3, 4, 5], [1, NaN, 3, 4, 5]), true, 0);
  expect(series.agrees(column([2, 3, 4, 6], [NaN, 3, 4, 6]), 2, 4.5)).toBe(true);
  expect(series.agrees(column([2, 3, 4], [NaN, 3, 9]), 2, 4.5)).toBe(false);
  expect(series.agrees(column([2, 3], [NaN, 3]), 2, 4.5)).toBe(false);
  expect(series.agrees(column([2, 3, 3.5, 4], [NaN, 3, 3, 4]), 2, 4.5)).toBe(false);
  expect(series.agrees(column([9], [9]), 6, 8)).toBe(true);
});
