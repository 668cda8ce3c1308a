// A press acts on the control that was under the finger when it began. Values and notices of a live page come and go, and
// what is below them moves; a browser clicks only where press and release hit the same element, so such a press would be
// lost.
const CONTROLS = "button, a[href], summary, label, input[type=checkbox], input[type=radio]";
const TAKEN_BACK = 12; // px: a pointer that left by more than this was moved away on purpose

interface Press {
  control: HTMLElement;
  pointer: number;
  x: number;
  y: number;
}

/** From now on presses on controls of this page survive movements between press and release. */
export function keepPresses(page: Document): void {
  let press: Press | null = null;
  let isDone = false; // the browser may still click an element that holds both places

  page.addEventListener(
    "pointerdown",
    (event) => {
      const control = event.target instanceof Element ? event.target.closest<HTMLElement>(CONTROLS) : null;
      const { pointerId: pointer, clientX: x, clientY: y } = event;
      press = control && event.isPrimary && event.button === 0 ? { control, pointer, x, y } : null;
      isDone = false;
    },
    { capture: true },
  );
  page.addEventListener(
    "pointerup",
    (event) => {
      const begun = press;
      press = null;
      if (begun?.pointer !== event.pointerId || begun.control.contains(event.target as Node)) return;
      if (Math.hypot(event.clientX - begun.x, event.clientY - begun.y) > TAKEN_BACK) return;
      begun.control.click();
      isDone = true;
    },
    { capture: true },
  );
  page.addEventListener("pointercancel", () => (press = null), { capture: true });
  page.addEventListener(
    "click",
    (event) => {
      if (!isDone || !event.isTrusted || event.detail === 0) return; // 0: by a key
      isDone = false;
      event.stopImmediatePropagation();
      event.preventDefault();
    },
    { capture: true },
  );
}
