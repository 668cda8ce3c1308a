// Paints the lines of a plot. Each column has times of its own, and a pixel's peaks are both ends of a stroke, so uPlot's
// own paths do not fit.
import type { Series } from "./series";

const SHORT = 32; // rows of one stroke: one through thousands of peaks takes many times longer to paint
const OVER = 2; // pixels beyond an edge, from which a line's width reaches in

export interface Line {
  series: Series;
  colour: string;
  dash: number[];
  isStepped: boolean; // a state: the line keeps its value until the next one
  least: number; // at the lower edge
  greatest: number; // at the upper edge
}

/** The lines from the time `begin` on, at the left edge of a canvas, as wide as `width` in device pixels.
 *  @param ratio device pixels of one pixel of the page */
export function paintLines(
  ctx: CanvasRenderingContext2D,
  lines: readonly Line[],
  begin: number,
  perSecond: number,
  width: number,
  height: number,
  lineWidth: number,
  ratio: number,
): void {
  // Thin lines with bevelled joins are several times cheaper to paint, which many series need.
  ctx.lineWidth = lineWidth;
  ctx.lineJoin = "bevel";
  for (const { series, colour, dash, isStepped, least, greatest } of lines) {
    const first = series.before(begin - OVER / perSecond);
    const end = series.behind(begin + (width + OVER) / perSecond);
    if (first >= end) continue;
    const perUnit = height / (greatest - least);
    const bottom = height + least * perUnit;
    ctx.strokeStyle = colour;
    ctx.setLineDash(dash);
    ctx.beginPath();
    let isDown = false;
    let last = 0;
    for (let i = first; i < end; i++) {
      const low = series.low[i]!;
      if (Number.isNaN(low)) {
        isDown = false;
        continue;
      }
      const high = series.high[i]!;
      const x = (series.t[i]! - begin) * perSecond;
      let yLow = bottom - low * perUnit;
      let yHigh = bottom - high * perUnit;
      if (yLow - yHigh < ratio) yLow = yHigh = (yLow + yHigh) / 2; // no peak that could be seen
      if (!isDown) {
        ctx.moveTo(x, yLow);
        if (i + 1 >= series.end || Number.isNaN(series.low[i + 1]!)) ctx.lineTo(x + 1, yLow); // alone between two gaps
      } else if (isStepped) {
        ctx.lineTo(x, last);
        ctx.lineTo(x, yLow);
      } else if (Math.abs(last - yLow) <= Math.abs(last - yHigh)) ctx.lineTo(x, yLow);
      else ctx.lineTo(x, yHigh);
      if (yLow !== yHigh) {
        if (!isDown || Math.abs(last - yLow) <= Math.abs(last - yHigh)) {
          ctx.lineTo(x, yHigh);
          last = yHigh;
        } else {
          ctx.lineTo(x, yLow);
          last = yLow;
        }
      } else last = yLow;
      isDown = true;
      if ((i - first) % SHORT === SHORT - 1) {
        ctx.stroke();
        ctx.beginPath();
        ctx.moveTo(x, last);
      }
    }
    ctx.stroke();
  }
}
