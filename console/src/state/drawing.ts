// Plots are drawn one in each frame of the browser: together they would make one frame long, and the page would stutter.
const waiting = new Set<() => void>();
let isAsked = false;

/** Draws soon. Asking again before that changes nothing. */
export function drawSoon(draw: () => void): void {
  waiting.add(draw);
  ask();
}

export function drawNever(draw: () => void): void {
  waiting.delete(draw);
}

function ask(): void {
  if (isAsked || waiting.size === 0) return;
  isAsked = true;
  requestAnimationFrame(() => {
    isAsked = false;
    const [next] = waiting;
    if (next) {
      waiting.delete(next);
      next();
    }
    ask();
  });
}
