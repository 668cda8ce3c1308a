// Events as sentences, and marks for the time line; each numbered, the oldest dropped first.
import type { LinkEvent } from "../views";

const MOST_EVENTS = 2000;
const MOST_MARKS = 20_000;
const TOGETHER = 0.25; // seconds: discards that are so close are one mark

class Numbered {
  newest = 0; // the number of the newest one
  private kept: { number: number; what: LinkEvent }[] = [];

  constructor(private readonly most: number) {}

  add(what: LinkEvent): void {
    this.kept.push({ number: ++this.newest, what });
    if (this.kept.length > 2 * this.most) this.kept = this.kept.slice(-this.most);
  }

  /** Takes the newest one back if it fits. */
  dropLast(fits: (what: LinkEvent) => boolean): void {
    if (this.kept.length > 0 && fits(this.kept.at(-1)!.what)) this.kept.pop();
  }

  /** Those with a higher number; none that happened after `until`. */
  since(number: number, until = Infinity): LinkEvent[] {
    return this.kept.filter((one) => one.number > number && one.what.t <= until).map((one) => one.what);
  }
}

export class Happenings extends Numbered {
  constructor() {
    super(MOST_EVENTS);
  }

  note(t: number, kind: string, facts: Record<string, unknown> = {}): void {
    this.add({ t, kind, text: sentence(kind, facts), ...facts });
  }
}

export class Marks extends Numbered {
  private readonly last = new Map<string, { t: number; bytes: number }>(); // the last discard of each direction

  constructor() {
    super(MOST_MARKS);
  }

  /** A deadline at the MCU has struck, judged by the sent messages. */
  struck(t: number, action: string, message: string): void {
    this.add({ t, kind: "mcu_deadline_struck", text: "", action, message });
  }

  /** Bytes were in no frame. Those close to the last ones of their direction are reported with them: the new mark has
   *  the same time and replaces theirs. */
  discarded(t: number, direction: string, size: number): void {
    let last = this.last.get(direction);
    if (!last || t - last.t >= TOGETHER) last = { t, bytes: 0 };
    const before = last.bytes;
    last.bytes += size;
    this.last.set(direction, last);
    const { t: begun, bytes } = last;
    if (before > 0) this.dropLast((one) => one.kind === "discarded" && one.t === begun && one.direction === direction);
    this.add({ t: begun, kind: "discarded", text: "", direction, bytes });
  }
}

function sentence(kind: string, facts: Record<string, unknown>): string {
  switch (kind) {
    case "port_up":
      return "the port is there";
    case "port_down":
      return facts.why ? `the port is away: ${facts.why as string}` : "the port is away";
    case "stopped":
      return "emergency stop";
    case "released":
      return "the emergency stop is released";
    case "deadline_struck":
      return `${facts.action as string}: its message stayed away`;
    case "deadline_ended":
      return `${facts.action as string} has ended`;
    case "lease_begun":
      return `${facts.message as string} is repeated`;
    case "lease_ended":
      return `${facts.message as string} is not repeated any more: ${String(facts.why).replaceAll("_", " ")}`;
    case "control":
      return `${facts.holder === null ? "nobody" : (facts.holder as string)} is in control (${facts.why as string})`;
    case "log":
    case "mark":
      return facts.text as string;
    default:
      return (
        kind +
        Object.entries(facts)
          .map(([name, value]) => `, ${name} ${String(value)}`)
          .join("")
      );
  }
}
