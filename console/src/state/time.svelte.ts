// One cursor, one pause and one clock for all plots and tables.
import { live } from "./live.svelte";

const EVERY = 200; // ms between two steps of the clock that ages are counted by

class SharedTime {
  /** The server's time at which all views are paused; null: all run. */
  pausedAt = $state<number | null>(null);
  /** Where the cursor is, in the server's time. */
  cursor = $state<number | null>(null);
  /** The server's time now, in steps; it stops while paused. */
  now = $state(0);

  constructor() {
    setInterval(() => {
      if (this.pausedAt === null) this.now = live.now();
    }, EVERY);
  }

  toggle(): void {
    this.pausedAt = this.pausedAt === null ? live.now() : null;
  }
}
export const time = new SharedTime();
