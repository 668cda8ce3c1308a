// How fast a link is, from two of its accounts: rates by message, losses, use of the line. See wirebond/link/rates.py.
import type { Protocol } from "../protocol";
import type { LinkView } from "../views";

const WINDOW = 2; // seconds
const MOST_LOOKS = 32;

/** The link's account, as the engine gives it (`account_node`). */
export interface Account {
  bytes: number;
  frames: number;
  messages: Record<string, number>;
  discarded_bytes: Record<string, number>;
  sequence: { gaps: number; numbered: number; repeats: number } | null;
  send: Record<string, number> & { messages?: Record<string, number> };
  [key: string]: unknown;
}
const sum = (counts: Record<string, number>) => Object.values(counts).reduce((total, count) => total + count, 0);
const part = (some: number, whole: number) => (whole > 0 ? Math.min(1, some / whole) : 0);
const lost = ({ send }: Account) =>
  ["refused_down", "refused_full", "refused_stopped", "expired", "overruled", "aborted"].reduce(
    (total, name) => total + send[name]!,
    0,
  );

export class RateMeter {
  private looks: { t: number; account: Account }[] = [];

  constructor(
    private readonly protocol: Protocol,
    private readonly baud: number,
  ) {}

  /** Since the newest look that is at least two seconds back; else since the oldest that is kept. */
  rates(account: Account, t: number): LinkView["rates"] {
    const earlier = this.looks.filter((look) => t - look.t >= WINDOW).at(-1) ?? this.looks[0] ?? { t, account };
    this.looks.push({ t, account });
    if (this.looks.length > MOST_LOOKS) this.looks.shift();
    const seconds = Math.max(t - earlier.t, 1e-6);
    const before = earlier.account;
    const bits = this.protocol.link.bits_per_byte;
    const size = account.bytes - before.bytes;
    const sent = account.send.sent_bytes! - before.send.sent_bytes!;
    const offered = account.send.offered! - before.send.offered!;
    return {
      seconds,
      receive: {
        bytes_per_second: size / seconds,
        frames_per_second: (account.frames - before.frames) / seconds,
        discarded: part(sum(account.discarded_bytes) - sum(before.discarded_bytes), size),
        missing: missing(before, account) as number,
        line_use: (size * bits) / this.baud / seconds,
      },
      send: {
        offered_per_second: offered / seconds,
        frames_per_second: (account.send.sent! - before.send.sent!) / seconds,
        lost: part(lost(account) - lost(before), offered),
        bytes_per_second: sent / seconds,
        line_use: (sent * bits) / this.baud / seconds,
      },
      messages: this.byMessage("mcu", before.messages, account.messages, seconds),
      sent: this.byMessage("host", before.send.messages ?? {}, account.send.messages ?? {}, seconds),
      baud: this.baud,
      bits_per_byte: bits,
    };
  }

  private byMessage(
    sender: string,
    before: Record<string, number>,
    now: Record<string, number>,
    seconds: number,
  ): LinkView["rates"]["messages"] {
    const rates: LinkView["rates"]["messages"] = {};
    for (const { name, sender: of, every } of this.protocol.messages) {
      const count = (now[name] ?? 0) - (before[name] ?? 0);
      if ((of !== "both" && of !== sender) || (count === 0 && every === null)) continue;
      const due = every === null ? null : 1 / every;
      const expected = due === null ? null : Math.max(0, seconds * due - 1); // one more or less is at the edges
      const gone = expected === null ? null : part(Math.max(0, expected - count), expected);
      rates[name] = { per_second: count / seconds, due, missing: gone };
    }
    return rates;
  }
}

function missing(before: Account, now: Account): number | null {
  if (!now.sequence) return null;
  const gaps = now.sequence.gaps - (before.sequence?.gaps ?? 0);
  const came = now.sequence.numbered - now.sequence.repeats;
  const cameBefore = before.sequence ? before.sequence.numbered - before.sequence.repeats : 0;
  return part(gaps, came - cameBefore + gaps);
}
