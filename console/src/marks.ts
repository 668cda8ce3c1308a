// What is marked on a line of time: stops, losses of the port, deadlines, log lines, discarded bytes, marks of persons.
import type { LinkEvent } from "./views";

/** The appearance of a mark; the worst first. */
export const TONES = ["stop", "bad", "warn", "accent", "muted"] as const;
export type Tone = (typeof TONES)[number];

const OF_KINDS: Record<string, Tone> = {
  stopped: "stop",
  port_down: "bad",
  lost: "bad",
  source_gone: "bad",
  discarded: "bad",
  port_settings: "warn",
  deadline_struck: "warn",
  mcu_deadline_struck: "warn",
  mark: "accent",
  port_up: "muted",
  released: "muted",
  deadline_ended: "muted",
};
const OF_LEVELS: Record<string, Tone> = { error: "bad", warning: "warn" };

/** Null: it is not marked. */
export function toneOf(event: LinkEvent): Tone | null {
  if (event.kind === "log") return OF_LEVELS[String(event.level)] ?? "muted";
  return OF_KINDS[event.kind] ?? null;
}

/** Of little weight each: there may be very many. */
export const isSmall = (event: LinkEvent) => event.kind === "discarded" || toneOf(event) === "muted";

/** The marks with the server's news: a discard of the same time and direction replaces the one before. */
export function joined(marks: readonly LinkEvent[], news: readonly LinkEvent[]): LinkEvent[] {
  const key = (mark: LinkEvent) => (mark.kind === "discarded" ? `${mark.t} ${mark.direction}` : null);
  const again = new Set(news.map(key));
  again.delete(null);
  return [...(again.size ? marks.filter((mark) => !again.has(key(mark))) : marks), ...news];
}

/** Marks too close to each other to be distinguished, the heaviest first. */
export interface Group {
  t: number; // of the heaviest
  tone: Tone;
  isSmall: boolean;
  marks: LinkEvent[];
}

/** Those from `from` to `to` in groups that are at least `gap` seconds apart, by time. */
export function grouped(marks: readonly LinkEvent[], from: number, to: number, gap: number): Group[] {
  const weight = (mark: LinkEvent) => Number(!isSmall(mark)) * TONES.length - TONES.indexOf(toneOf(mark)!);
  const shown = marks.filter((mark) => toneOf(mark) !== null && mark.t >= from && mark.t <= to);
  const groups = new Map<number, Group>(); // by a number that rises by one within `gap`: at most one has each
  for (const mark of shown.sort((a, b) => weight(b) - weight(a) || a.t - b.t)) {
    const place = Math.floor((mark.t - from) / gap);
    const near = [place, place - 1, place + 1]
      .map((one) => groups.get(one))
      .find((group) => group && Math.abs(group.t - mark.t) < gap);
    if (near) near.marks.push(mark);
    else groups.set(place, { t: mark.t, tone: toneOf(mark)!, isSmall: isSmall(mark), marks: [mark] });
  }
  return [...groups.values()].sort((a, b) => a.t - b.t);
}
