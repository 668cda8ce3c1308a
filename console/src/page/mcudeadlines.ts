// Which deadlines at the MCU have struck, by what the host sent. Most MCUs do not say so, but the rule is in the protocol
// file, and silence is known at this end, too.
import type { GivenMessage, Protocol } from "../protocol";

interface Watch {
  index: number; // of the file's deadlines
  rule: Protocol["deadlines"][number];
  since: number | null; // when its silence began; null: not known
  reported: number | null; // the silence whose strike was reported
}
/** A message that the host sent: when, and its values if the rules need them. */
export interface Sent {
  t: number;
  name: string;
  fields(): Record<string, unknown> | null;
}
const isExplicit = (watch: Watch) => watch.rule.recover === "explicit";
const hasStruck = (watch: Watch, now: number) => watch.since !== null && now - watch.since >= watch.rule.after;

export class McuDeadlines {
  private readonly watches: Watch[];
  private found: { t: number; action: string; message: string }[] = [];
  /** The messages that matter here. */
  readonly names: ReadonlySet<string>;

  constructor(protocol: Protocol) {
    this.watches = protocol.deadlines
      .map((rule, index) => ({ index, rule, since: null, reported: null }))
      .filter((watch) => watch.rule.at === "mcu");
    const enders = this.watches.flatMap((watch) => watch.rule.recover_by?.message ?? []);
    this.names = new Set([...this.watches.map((watch) => watch.rule.message), ...enders]);
  }

  /** Frames of the host, in their order, newer than all before. */
  sent(frames: Sent[]): void {
    for (const frame of frames) {
      for (const watch of this.watches) {
        const by = watch.rule.recover_by;
        if (by?.message === frame.name && isGiven(by, frame.fields())) this.recover(watch, frame.t);
      }
      this.act(
        this.watches.filter((watch) => watch.rule.message === frame.name),
        frame.t,
      );
    }
  }

  /** For each, its place in the file, and since when it has struck; `unknown`: its message was not sent yet. */
  states(now: number): { deadline: number; since: number | null; unknown: boolean }[] {
    return this.watches.map((watch) => ({
      deadline: watch.index,
      since: hasStruck(watch, now) ? watch.since! + watch.rule.after : null,
      unknown: watch.since === null,
    }));
  }

  /** Which have struck up to now, and when: each once. */
  strikes(now: number): { t: number; action: string; message: string }[] {
    for (const watch of this.watches) this.strike(watch, now);
    const found = this.found;
    this.found = [];
    return found;
  }

  private strike(watch: Watch, now: number): void {
    if (!hasStruck(watch, now) || watch.reported === watch.since) return;
    watch.reported = watch.since;
    this.found.push({ t: watch.since! + watch.rule.after, action: watch.rule.then, message: watch.rule.message });
  }

  /** Their message was sent: silence begins again, unless one of them holds messages back. */
  private act(watches: Watch[], t: number): void {
    if (watches.some((watch) => (watch.rule as { start?: string }).start === "held" && watch.since === null)) return;
    if (watches.some((watch) => isExplicit(watch) && hasStruck(watch, t))) {
      for (const watch of watches) this.strike(watch, t);
      return;
    }
    for (const watch of watches) {
      this.strike(watch, t);
      watch.since = t;
    }
  }

  /** As the MCU does it: nothing if it has not struck; each explicit one is ended by its own message. */
  private recover(ended: Watch, t: number): void {
    if (ended.since !== null && !hasStruck(ended, t)) return;
    for (const watch of this.watches.filter((one) => one.rule.message === ended.rule.message)) {
      this.strike(watch, t);
      if (watch === ended || !(isExplicit(watch) && hasStruck(watch, t))) watch.since = t;
    }
  }
}

/** Are these the values that the file gives the message? */
function isGiven(given: GivenMessage, fields: Record<string, unknown> | null): boolean {
  return (
    fields !== null &&
    Object.entries(given.fields).every(([name, value]) => JSON.stringify(fields[name]) === JSON.stringify(value))
  );
}
