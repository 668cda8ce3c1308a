// Paints the lines of a plot. Each column has times of its own, and a pixel's peaks are both ends of a stroke, so uPlot's
// own paths do not fit.
import type { Series } from "./series";

const SHORT = 32; // rows of one stroke: one through thousands of peaks takes many times longer to paint
const TALL = 4; // widths of a line: what reaches farther up and down in one pixel is filled, which is cheaper than a stroke
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
  const fillWidth = Math.max(1, Math.floor(lineWidth));
  for (const { series, colour, dash, isStepped, least, greatest } of lines) {
    const first = series.before(begin - OVER / perSecond);
    const end = series.behind(begin + (width + OVER) / perSecond);
    if (first >= end) continue;
    const perUnit = height / (greatest - least);
    const zero = height + least * perUnit; // where 0 is
    ctx.strokeStyle = ctx.fillStyle = colour;
    ctx.setLineDash(dash);
    ctx.beginPath();
    let isDown = false;
    let last = 0; // where the pen is
    let top = 0; // of the row before
    let bottom = 0;
    for (let i = first; i < end; i++) {
      const low = series.low[i]!;
      if (Number.isNaN(low)) {
        isDown = false;
        continue;
      }
      const high = series.high[i]!;
      const x = (series.t[i]! - begin) * perSecond;
      let yLow = zero - low * perUnit;
      let yHigh = zero - high * perUnit;
      if (yLow - yHigh < ratio) yLow = yHigh = (yLow + yHigh) / 2; // no peak that could be seen
      const isNearLow = !isDown || Math.abs(last - yLow) <= Math.abs(last - yHigh);
      const near = isNearLow ? yLow : yHigh;
      const far = isNearLow ? yHigh : yLow;
      const isTall = yLow - yHigh > TALL * lineWidth && dash.length === 0;
      if (!isDown) {
        ctx.moveTo(x, near);
        if (i + 1 >= series.end || Number.isNaN(series.low[i + 1]!)) ctx.lineTo(x + 1, near); // alone between two gaps
      } else if (isStepped) {
        ctx.lineTo(x, last);
        ctx.lineTo(x, near);
      } else if (!isTall || yLow < top || yHigh > bottom) ctx.lineTo(x, near); // else it touches the row before
      if (isTall) {
        const left = Math.round(x);
        const next = i + 1 < series.end ? Math.round((series.t[i + 1]! - begin) * perSecond) - left : 0;
        ctx.fillRect(left, yHigh, next <= 2 * ratio ? Math.max(fillWidth, next) : fillWidth, yLow - yHigh);
        ctx.moveTo(x, far);
      } else if (yLow !== yHigh) ctx.lineTo(x, far);
      last = far;
      top = yHigh;
      bottom = yLow;
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
