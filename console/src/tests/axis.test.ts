import { expect, test } from "vitest";
import { roomFor, valueTicks } from "../axis";

test("numbers on an axis have the digits that tell them apart", () => {
  expect(valueTicks([0, 0.5, 1])).toEqual(["0.0", "0.5", "1.0"]);
  expect(valueTicks([-20000, 0, 20000])).toEqual(["−20 000", "0", "20 000"]);
  expect(valueTicks([2e9, 2e9 + 1])).toEqual(["2 000 000 000", "2 000 000 001"]);
});

test("numbers at equal distances read so", () => {
  expect(valueTicks([0, 0.0025, 0.005, 0.0075])).toEqual(["0.0000", "0.0025", "0.0050", "0.0075"]);
  expect(valueTicks([0, 2.5, 5])).toEqual(["0.0", "2.5", "5.0"]);
  expect(valueTicks([0, 25, 50])).toEqual(["0", "25", "50"]);
});

test("very small and very large numbers are told apart, too", () => {
  expect(valueTicks([-2e-9, 0, 2e-9])).toEqual(["−2e−9", "0", "2e−9"]);
  expect(valueTicks([1.5e-8, 1.6e-8])).toEqual(["1.5e−8", "1.6e−8"]);
  expect(valueTicks([1e18, 2e18])).toEqual(["1e+18", "2e+18"]);
});

test("an axis is as wide as its widest number needs, in steps", () => {
  const measure = (text: string) => 7 * text.length;
  expect(roomFor(["0", "10"], measure)).toBe(64);
  expect(roomFor([], measure)).toBe(64);
  const wide = roomFor(["2 000 000 000"], measure);
  expect(wide).toBeGreaterThanOrEqual(7 * 13 + 12);
  expect(roomFor(["2 000 000 000", "7"], measure)).toBe(wide);
});
