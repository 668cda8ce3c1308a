// The other end: its hello says from which file its firmware was built.
import type { Facts } from "./facts";

const FIRST_WAIT = 0.5; // seconds for the answer to a hello, before it is said again
const LAST_WAIT = 30; // the wait doubles up to this
const ANSWER_TIME = 1; // a hello that comes within so long is the answer to ours; a later one the MCU said by itself

export class PeerBook {
  state: "unknown" | "same" | "different" = "unknown";
  why: string;
  private known: bigint | null = null;
  private asks: number[] = []; // when; of hellos that are not answered
  private wait = FIRST_WAIT;
  private due = Infinity;
  private readonly hash: bigint;

  constructor(private readonly facts: Facts) {
    this.hash = BigInt(`0x${facts.protocol.hash}`);
    this.why = facts.hello
      ? "the MCU has not said hello yet; check that its firmware runs"
      : `${facts.protocol.name} maps no \`hello\` service, so the MCU cannot say which file it has`;
  }

  /** The port is open, or open again: the device is not known yet. */
  connected(t: number): void {
    this.state = "unknown";
    this.known = null;
    this.asks = [];
    this.wait = FIRST_WAIT;
    this.due = t;
  }

  isDue(t: number): boolean {
    return t >= this.due;
  }

  asked(t: number): void {
    this.asks.push(t);
    this.due = t + this.wait;
    this.wait = Math.min(2 * this.wait, LAST_WAIT);
  }

  /** What this end says. */
  hello(): Record<string, unknown> {
    return { ...this.facts.hello!.fields, protocol_hash: this.hash };
  }

  heard(fields: Record<string, unknown>, t: number): void {
    this.asks = this.asks.filter((asked) => t - asked < ANSWER_TIME);
    const isAnswer = this.asks.shift() !== undefined;
    this.due = !isAnswer && this.known !== null ? t : Infinity; // a restarted MCU does not know us
    if (this.due === t) this.wait = FIRST_WAIT;
    this.known = BigInt(fields.protocol_hash as number | bigint);
    const isSame = this.known === this.hash;
    this.state = isSame ? "same" : "different";
    const digits = (hash: bigint) => hash.toString(16).padStart(16, "0");
    this.why = isSame
      ? ""
      : `the MCU was built from another protocol file: its hash is ${digits(this.known)}, and that of ` +
        `${this.facts.protocol.name} here is ${digits(this.hash)}. Messages may mean something else; build the firmware ` +
        "from this file and flash it, or make this page from the file that the firmware was built from";
  }
}
