import { expect, test } from "vitest";
import { chooseColours, COLOURS, seriesColour } from "../colours";

type Triple = [number, number, number];
// Machado, Oliveira and Fernandes 2009, severity 1, of linear sRGB.
const SIGHT = {
  normal: [1, 0, 0, 0, 1, 0, 0, 0, 1],
  protan: [0.152286, 1.052583, -0.204868, 0.114503, 0.786281, 0.099216, -0.003882, -0.048116, 1.051998],
  deutan: [0.367322, 0.860646, -0.227968, 0.280085, 0.672501, 0.047413, -0.01182, 0.04294, 0.968881],
  tritan: [1.255528, -0.076749, -0.178779, -0.078411, 0.930809, 0.147602, 0.004733, 0.691367, 0.3039],
};
const LEAST = 6; // hundredths in OKLab: two colours side by side are told apart from about 2 on
const BACKGROUNDS = { false: ["#ffffff", "#f4f5f7"], true: ["#161a20", "#0e1115"] };

function linear(hex: string): Triple {
  return [1, 3, 5].map((at) => {
    const value = parseInt(hex.slice(at, at + 2), 16) / 255;
    return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
  }) as Triple;
}
const luminance = (hex: string) => linear(hex).reduce((sum, value, i) => sum + value * [0.2126, 0.7152, 0.0722][i]!, 0);
function contrast(one: string, other: string): number {
  const [light, dark] = [luminance(one), luminance(other)].sort((a, b) => b - a);
  return (light! + 0.05) / (dark! + 0.05);
}
function seen(matrix: number[], [r, g, b]: Triple): Triple {
  const row = (at: number) => matrix[at]! * r + matrix[at + 1]! * g + matrix[at + 2]! * b;
  return [0, 3, 6].map((at) => Math.min(1, Math.max(0, row(at)))) as Triple;
}
function oklab([r, g, b]: Triple): Triple {
  const l = Math.cbrt(0.4122214708 * r + 0.5363325363 * g + 0.0514459929 * b);
  const m = Math.cbrt(0.2119034982 * r + 0.6806995451 * g + 0.1073969566 * b);
  const s = Math.cbrt(0.0883024619 * r + 0.2817188376 * g + 0.6299787005 * b);
  return [
    0.2104542553 * l + 0.793617785 * m - 0.0040720468 * s,
    1.9779984951 * l - 2.428592205 * m + 0.4505937099 * s,
    0.0259040371 * l + 0.7827717662 * m - 0.808675766 * s,
  ];
}

test.each([false, true])("eight colours are told apart by everybody, and from the background; dark: %s", (isDark) => {
  const colours = Array.from({ length: COLOURS }, (_, index) => seriesColour(index, isDark));
  expect(new Set(colours).size).toBe(8);
  for (const background of BACKGROUNDS[`${isDark}`])
    for (const colour of colours) expect(contrast(colour, background), colour).toBeGreaterThan(3);
  for (const [sight, matrix] of Object.entries(SIGHT)) {
    const points = colours.map((colour) => oklab(seen(matrix, linear(colour))));
    points.forEach((one, i) =>
      points.slice(0, i).forEach((other, j) => {
        const apart = 100 * Math.hypot(...one.map((value, axis) => value - other[axis]!));
        expect(apart, `${sight}: ${colours[i]} ${colours[j]}`).toBeGreaterThan(LEAST);
      }),
    );
  }
});

const fields = (count: number, first = 0) => Array.from({ length: count }, (_, index) => `m.f${first + index}`);

test("eight series of a plot have eight colours, whatever lies between them in the file", () => {
  const plot = ["a.x", "a.z", "b.k", "c.p", "c.q", "d.a", "d.b", "e.z"];
  expect(new Set(chooseColours([plot], new Map()).values()).size).toBe(8);
  const two = chooseColours([fields(5), fields(8, 3)], new Map());
  expect(new Set(fields(8, 3).map((field) => two.get(field))).size).toBe(8);
});

test("a field keeps its colour in all plots, and when others come and go", () => {
  const first = chooseColours([["x", "y"], ["z"]], new Map());
  const second = chooseColours([["y"], ["z", "w"]], first);
  expect(second.get("y")).toBe(first.get("y"));
  expect(second.get("z")).toBe(first.get("z"));
  expect(second.has("x")).toBe(false);
  expect(new Set(second.values()).size).toBe(3);
});
