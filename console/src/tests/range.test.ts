import { expect, test } from "vitest";
import { around, calmScale } from "../range";

test("more is asked for than is shown, and no more until the range comes near an end of it", () => {
  const asked = around(100, 110, null);
  expect(asked).toEqual({ from: 90, to: 120, times: 3 });
  expect(around(104.9, 114.9, asked)).toBe(asked);
  expect(around(95.1, 105.1, asked)).toBe(asked);
  expect(around(105.1, 115.1, asked)).toEqual({ from: 95.1, to: 125.1, times: 3 });
  expect(around(94.9, 104.9, asked).from).toBeCloseTo(84.9);
});

test("another width is asked for at once", () => {
  const asked = around(100, 110, null);
  expect(around(101, 109, asked)).toEqual({ from: 93, to: 117, times: 3 });
});

test("a scale stays while the values fit it and fill most of it", () => {
  const first = calmScale(0, 100, 0.5, null);
  expect(first).toEqual([-6, 106]);
  expect(calmScale(2, 95, 0.5, first)).toEqual(first);
  expect(calmScale(0, 106, 0.5, first)).toEqual(first);
  expect(calmScale(0, 200, 0.5, first)).toEqual([-12, 212]);
  expect(calmScale(0, 50, 0.5, first)).toEqual([-3, 53]);
});

test("a scale has room for values that are all the same, and for none", () => {
  const flat = calmScale(7, 7, 0.5, null);
  expect(flat).toEqual([6.5, 7.5]);
  expect(calmScale(7, 7, 0.5, flat)).toEqual(flat);
  expect(calmScale(Infinity, -Infinity, 0.5, flat)).toEqual([0, 1]);
});
