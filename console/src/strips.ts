// Lines as pictures in strips, kept while the range slides: a strip is painted once and copied from then on. No uPlot here.

export const STRIP = 128; // device pixels
const KEPT = 3; // times as many strips as are in view

/** Paints from `begin` on, at `perSecond` device pixels, into a canvas of `STRIP` and `height`. */
export type Paint = (ctx: CanvasRenderingContext2D, begin: number, perSecond: number, height: number) => void;
/** Where in a canvas, in device pixels. */
export interface Box {
  left: number;
  top: number;
  width: number;
  height: number;
}

export class Strips {
  private readonly painted = new Map<number, HTMLCanvasElement>(); // by their number, counted from time 0
  private readonly spare: HTMLCanvasElement[] = [];
  private look = "";
  private perSecond = 0;

  /** Shows `from` to `to` in `box`. How many strips had to be painted for it.
   *  @param look whatever else the picture depends on; when it changes, nothing that was painted is right any more */
  show(ctx: CanvasRenderingContext2D, box: Box, from: number, to: number, look: string, paint: Paint): number {
    const perSecond = box.width / (to - from);
    // The width of a range that slides differs in its last digits.
    if (look !== this.look || Math.abs(perSecond / this.perSecond - 1) > 1e-6) {
      this.forget();
      this.look = look;
      this.perSecond = perSecond;
    }
    const seconds = STRIP / this.perSecond;
    const first = Math.floor(from / seconds);
    const left = box.left + Math.round((first * seconds - from) * this.perSecond);
    let count = 0;
    let index = first;
    for (let x = left; x < box.left + box.width; x += STRIP, index++) {
      let strip = this.painted.get(index);
      if (!strip) {
        strip = this.empty(box.height);
        paint(strip.getContext("2d")!, index * seconds, this.perSecond, box.height);
        this.painted.set(index, strip);
        count++;
      }
      ctx.drawImage(strip, x, box.top);
    }
    this.drop(first, index);
    return count;
  }

  /** The part outside of `from` to `to` is to be painted again. */
  keep(from: number, to: number): void {
    const seconds = STRIP / this.perSecond;
    for (const index of [...this.painted.keys()])
      if (!(index * seconds >= from && (index + 1) * seconds <= to)) this.remove(index);
  }

  private forget(): void {
    for (const index of [...this.painted.keys()]) this.remove(index);
  }

  /** Those farthest from the view go. */
  private drop(first: number, end: number): void {
    const most = KEPT * (end - first);
    if (this.painted.size <= most) return;
    const middle = (first + end) / 2;
    const far = [...this.painted.keys()].sort((a, b) => Math.abs(b - middle) - Math.abs(a - middle));
    for (const index of far.slice(0, this.painted.size - most)) this.remove(index);
  }

  private remove(index: number): void {
    this.spare.push(this.painted.get(index)!);
    this.painted.delete(index);
  }

  private empty(height: number): HTMLCanvasElement {
    const strip = this.spare.pop() ?? document.createElement("canvas");
    strip.width = STRIP; // this clears it
    strip.height = height;
    return strip;
  }
}
