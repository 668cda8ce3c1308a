// How long replies took, from the times of requests and replies alone.
const WINDOW = 60; // seconds
const MOST_KEPT = 4096;
const MOST_WAITING = 256;
const NEVER_ANSWERED = 1; // seconds

export class RoundTrips {
  private readonly asked = new Map<string, number[]>(); // by reply, when
  private found: { t: number; seconds: number }[] = [];

  ask(reply: string, times: Iterable<number>): void {
    const waiting = this.asked.get(reply) ?? [];
    waiting.push(...times);
    this.asked.set(reply, waiting.slice(-MOST_WAITING));
  }

  /** Such messages came. Each answers the oldest request that waits. */
  answer(reply: string, times: Iterable<number>): void {
    const waiting = this.asked.get(reply);
    if (!waiting) return;
    for (const t of times) {
      let before: number | undefined;
      while (waiting.length > 0 && waiting[0]! <= t) {
        before = waiting.shift();
        if (waiting.length === 0 || waiting[0]! > t - NEVER_ANSWERED) break;
      }
      if (before !== undefined) this.found.push({ t, seconds: t - before });
    }
    if (this.found.length > MOST_KEPT) this.found = this.found.slice(-MOST_KEPT);
  }

  /** Percentiles of the last minute, in seconds; null: there was none. */
  figures(now: number): { count: number; p50: number; p95: number; p99: number; max: number } | null {
    this.found = this.found.filter((one) => one.t >= now - WINDOW);
    const taken = this.found.map((one) => one.seconds).sort((a, b) => a - b);
    if (taken.length === 0) return null;
    const at = (part: number) => {
      const place = part * (taken.length - 1);
      const low = Math.floor(place);
      const above = taken[Math.min(low + 1, taken.length - 1)]!;
      return taken[low]! + (place - low) * (above - taken[low]!);
    };
    return { count: taken.length, p50: at(0.5), p95: at(0.95), p99: at(0.99), max: taken.at(-1)! };
  }
}
