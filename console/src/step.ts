// What a response to a step says: how fast, how far over, when settled, how far off. No socket, no clock.
export interface Response {
  initial: number;
  final: number;
  rise: number | null; // seconds from 10 % to 90 %; null: not reached
  overshoot: number; // part of the step, 0: none
  settling: number | null; // seconds from the step until it stays within the band; null: it does not
  steadyError: number | null; // reference minus final; null: there is no reference
}
export type Problem = "too_few" | "no_response";

const BAND = 0.05; // of the step, for settling
const TAIL = 0.25; // of the time after the step, whose mean is the final value
const LEAST = 8; // samples on each side

/** Samples by time, the moment of the step, and the wanted value (null: not known). */
export function analyse(t: number[], y: number[], step: number, reference: number | null): Response | Problem {
  const before: number[] = [];
  const after: { t: number; y: number }[] = [];
  t.forEach((at, index) => {
    const value = y[index]!;
    if (!Number.isFinite(at) || !Number.isFinite(value)) return;
    if (at < step) before.push(value);
    else after.push({ t: at - step, y: value });
  });
  if (before.length < 2 || after.length < LEAST) return "too_few";
  const recent = before.slice(-Math.max(LEAST, Math.floor(before.length / 2)));
  const initial = mean(recent);
  const end = after.at(-1)!.t;
  const tail = after.filter((sample) => sample.t >= end * (1 - TAIL)).map((sample) => sample.y);
  const final = mean(tail);
  const size = final - initial;
  const noise = Math.max(deviation(recent), deviation(tail));
  if (Math.abs(size) <= 3 * noise || size === 0) return "no_response";
  const part = after.map((sample) => ({ t: sample.t, share: (sample.y - initial) / size }));
  const low = crossing(part, 0.1);
  const high = crossing(part, 0.9);
  const peak = Math.max(...part.map((sample) => sample.share));
  const band = Math.max(BAND, (2 * noise) / Math.abs(size));
  let settling: number | null = 0;
  for (let index = part.length - 1; index >= 0; index--)
    if (Math.abs(part[index]!.share - 1) > band) {
      settling = part[index + 1]?.t ?? null;
      break;
    }
  return {
    initial,
    final,
    rise: low === null || high === null ? null : high - low,
    overshoot: Math.max(0, peak - 1),
    settling,
    steadyError: reference === null ? null : reference - final,
  };
}

/** Mean, standard deviation, minimum and maximum of a field that should be constant. */
export function stillness(y: number[]): { mean: number; spread: number; low: number; high: number } | null {
  const known = y.filter(Number.isFinite);
  if (known.length < LEAST) return null;
  return { mean: mean(known), spread: deviation(known), low: Math.min(...known), high: Math.max(...known) };
}

/** The time at which it first reaches `share`, between samples. */
function crossing(part: { t: number; share: number }[], share: number): number | null {
  const index = part.findIndex((sample) => sample.share >= share);
  if (index < 0) return null;
  const now = part[index]!;
  const last = part[index - 1];
  if (!last || now.share === last.share) return now.t;
  return last.t + ((share - last.share) / (now.share - last.share)) * (now.t - last.t);
}

function mean(values: number[]): number {
  return values.reduce((sum, value) => sum + value, 0) / values.length;
}

function deviation(values: number[]): number {
  const middle = mean(values);
  return Math.sqrt(mean(values.map((value) => (value - middle) ** 2)));
}
