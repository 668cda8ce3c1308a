// Who wants to draw does so in the browser's next frame. One that had to paint much is the last of its frame: several
// together would make it long, and the page would stutter.
const waiting = new Set<Draw>();
let isAsked = false;

/** Says whether it had to paint much. */
export type Draw = () => boolean;

/** Draws soon. Asking again before that changes nothing. */
export function drawSoon(draw: Draw): void {
  waiting.add(draw);
  ask();
}

export function drawNever(draw: Draw): void {
  waiting.delete(draw);
}

function ask(): void {
  if (isAsked || waiting.size === 0) return;
  isAsked = true;
  requestAnimationFrame(() => {
    isAsked = false;
    for (const next of [...waiting]) {
      waiting.delete(next);
      if (next()) break;
    }
    ask();
  });
}
