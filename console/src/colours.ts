// Colours of series and of a frame's parts: Okabe and Ito's palette, which colour-blind people can tell apart, moved in
// lightness where the background needs it. The same field has the same colour everywhere.

/** Black and yellow of the palette are left out: each vanishes on one of the backgrounds. */
const LIGHT = ["#0072b2", "#d55e00", "#008a64", "#b0568a", "#a87400", "#2b8fc4", "#6b6b6b"];
const DARK = ["#56b4e9", "#ff8a3c", "#2fc79a", "#e39ac3", "#e6b422", "#9fd4f5", "#b8b8b8"];

export const COLOURS = LIGHT.length;

export function seriesColour(index: number, isDark: boolean): string {
  return (isDark ? DARK : LIGHT)[index % COLOURS] ?? LIGHT[0]!;
}

/** Behind the seventh series the colours repeat, with dashes. */
export function seriesDash(index: number): number[] | undefined {
  return index < COLOURS ? undefined : [6, 4];
}
