// Colours of series and of a frame's parts: the eight hues of Okabe and Ito's palette, moved until colour-blind people tell
// each two apart, and each from the background: yellow and black of the palette vanish on one of them.

const LIGHT = ["#0b58b9", "#f54000", "#008c60", "#d54d9d", "#858322", "#2d91d4", "#001d05", "#666770"];
const DARK = ["#3aa2ff", "#ff5400", "#08e39c", "#d66cba", "#f4b601", "#cfc7ff", "#ffffca", "#6c6183"];

export const COLOURS = LIGHT.length;

export function seriesColour(index: number, isDark: boolean): string {
  return (isDark ? DARK : LIGHT)[index % COLOURS] ?? LIGHT[0]!;
}

/** A series whose colour another one of its plot has already has dashes. */
export const AGAIN = [6, 4];

/** Gives each plotted field a colour: one that no field beside it in a plot has, and that few others have. A field that has
 *  one keeps it, in all plots. */
export function chooseColours(plots: readonly (readonly string[])[], before: ReadonlyMap<string, number>) {
  const plotted = new Set(plots.flat());
  const chosen = new Map([...before].filter(([field]) => plotted.has(field)));
  const all = Array.from({ length: COLOURS }, (_, index) => index);
  for (const field of plotted) {
    if (chosen.has(field)) continue;
    const beside = plots.filter((plot) => plot.includes(field)).flat();
    const count = (fields: readonly string[], index: number) =>
      fields.filter((one) => chosen.get(one) === index).length;
    const cost = (index: number) => count(beside, index) * (plotted.size + 1) + count([...plotted], index);
    chosen.set(
      field,
      all.reduce((best, index) => (cost(index) < cost(best) ? index : best)),
    );
  }
  return chosen;
}
