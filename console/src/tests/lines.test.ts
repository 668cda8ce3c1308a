import { beforeEach, expect, test } from "vitest";
import { paintLines } from "../lines";
import { Series } from "../series";

let inked: [number, number, number][]; // x, and between which y there is ink
let at: [number, number];
const ctx = {
  beginPath() {},
  stroke() {},
  setLineDash() {},
  moveTo: (x: number, y: number) => (at = [x, y]),
  lineTo: (x: number, y: number) => {
    inked.push([Math.round(x), Math.min(at[1], y), Math.max(at[1], y)]);
    at = [x, y];
  },
  fillRect: (x: number, y: number, width: number, height: number) => {
    for (let column = x; column < x + width; column++) inked.push([column, y, y + height]);
  },
} as unknown as CanvasRenderingContext2D;
const reach = (x: number) => {
  const here = inked.filter(([column]) => column === x);
  return [Math.min(...here.map(([, top]) => top)), Math.max(...here.map(([, , bottom]) => bottom))];
};
/** Rows one pixel apart, of values from 0 to 100 in a picture 100 pixels high. */
function paint(low: number[], high: number[] = low, dash: number[] = []): void {
  const series = new Series();
  const column = { field: "a.x", t: low.map((_, n) => n), low, high };
  const arrays = { t: Float64Array.from(column.t), low: Float64Array.from(low), high: Float64Array.from(high) };
  series.take({ field: "a.x", ...arrays }, true, 0);
  const line = { series, colour: "red", dash, isStepped: false, least: 0, greatest: 100 };
  paintLines(ctx, [line], 0, 1, low.length, 100, 1, 1);
}
beforeEach(() => {
  inked = [];
  at = [NaN, NaN];
});

test.each([[[]], [[6, 4]]])("a pixel's peak reaches from its least to its greatest value, dashed or not", (dash) => {
  paint([50, 50, 10, 50, 50], [50, 50, 90, 50, 50], dash);
  expect(reach(2)).toEqual([10, 90]);
  expect(reach(4)).toEqual([50, 50]);
});

test("tall pixels side by side leave no column out, and one that lies apart is joined", () => {
  paint([10, 10, 10, 80, 80], [60, 60, 60, 99, 99]);
  for (const x of [0, 1, 2]) expect(reach(x)).toEqual([40, 90]);
  expect(reach(3)).toEqual([1, 40]); // from the row before up to its own
  expect(reach(4)).toEqual([1, 20]);
});

test("nothing is drawn over a gap", () => {
  paint([50, NaN, NaN, 50, 50]);
  expect(inked.map(([x]) => x).sort()).toEqual([1, 4]); // a row alone is a dot as wide as a pixel
});
