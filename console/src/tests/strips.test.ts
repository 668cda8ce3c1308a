import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { STRIP, Strips } from "../strips";

const box = { left: 64, top: 10, width: 4 * STRIP, height: 200 };
let shown: number[]; // where each strip of the last picture lies
let painted: number[]; // the times at which painted strips begin
let strips: Strips;
const ctx = { drawImage: (_: unknown, x: number) => shown.push(x) } as unknown as CanvasRenderingContext2D;

beforeEach(() => {
  vi.stubGlobal("document", { createElement: () => ({ getContext: () => ({}) }) });
  strips = new Strips();
  painted = [];
});
afterEach(() => vi.unstubAllGlobals());

/** A picture of 8 seconds, so that a strip is 2 seconds wide. */
function show(from: number, look = "", seconds = 8): number {
  shown = [];
  return strips.show(ctx, box, from, from + seconds, look, (_, begin) => painted.push(begin));
}

test("strips lie side by side and cover the whole box", () => {
  expect(show(101)).toBe(5);
  expect(painted).toEqual([100, 102, 104, 106, 108]);
  expect(shown).toEqual([0, 1, 2, 3, 4].map((n) => box.left - STRIP / 2 + n * STRIP));
});

test("a range that slides paints only what comes into view, and on its way back nothing", () => {
  show(100);
  expect(show(100.7)).toBe(1);
  expect(show(102.7)).toBe(1);
  expect(painted.slice(-2)).toEqual([108, 110]);
  expect(show(100.7)).toBe(0);
});

test("what changed is painted again, and nothing else", () => {
  show(101);
  painted = [];
  strips.keep(-Infinity, 105);
  expect(show(101)).toBe(3);
  expect(painted).toEqual([104, 106, 108]);
  strips.keep(101, 109);
  expect(show(101)).toBe(2);
  strips.keep(Infinity, -Infinity);
  expect(show(101)).toBe(5);
});

test("another scale or another width is another picture", () => {
  show(100);
  expect(show(100)).toBe(0);
  expect(show(100, "taller")).toBe(4);
  expect(show(100, "taller", 16)).toBe(4);
});

test("strips far from the view are dropped", () => {
  for (let from = 0; from < 1000; from += 2) show(from);
  expect(show(990)).toBe(0);
  expect(show(0)).toBe(4);
});
