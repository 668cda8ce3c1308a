// What is marked on a line of time: stops, losses of the port, deadlines, log lines, discarded bytes, marks of persons.
import type { LinkEvent } from "./views";

/** How a mark looks; the worst first. */
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

/** The marks with the news of the server: a discard of the same time and direction stands for the one before. */
export function joined(marks: readonly LinkEvent[], news: readonly LinkEvent[]): LinkEvent[] {
  const key = (mark: LinkEvent) => (mark.kind === "discarded" ? `${mark.t} ${mark.direction}` : null);
  const again = new Set(news.map(key));
  again.delete(null);
  return [...(again.size ? marks.filter((mark) => !again.has(key(mark))) : marks), ...news];
}

export interface Group {
  t: number; // of the first one
  tone: Tone;
  isSmall: boolean;
  marks: LinkEvent[];
}

/** Those from `from` to `to` in `places` places beside each other: in each one group of a look. The heaviest come last, so
 *  that they lie on top. */
export function grouped(marks: readonly LinkEvent[], from: number, to: number, places: number): Group[] {
  const groups = new Map<string, Group>();
  for (const mark of marks) {
    const tone = toneOf(mark);
    if (tone === null || mark.t < from || mark.t > to) continue;
    const place = Math.min(places - 1, Math.floor(((mark.t - from) / (to - from || 1)) * places));
    const key = `${place} ${tone} ${isSmall(mark)}`;
    const group = groups.get(key);
    if (group) group.marks.push(mark);
    else groups.set(key, { t: mark.t, tone, isSmall: isSmall(mark), marks: [mark] });
  }
  const weight = (group: Group) => Number(!group.isSmall) * TONES.length - TONES.indexOf(group.tone);
  return [...groups.values()].sort((a, b) => weight(a) - weight(b));
}
