// A value that is renewed while somebody wants it, and ends with its safe value when not. The server's lease is short: a
// page that is gone renews nothing, and the robot stops by itself.
import { Refusal } from "../link";
import { session } from "./session.svelte";
import { notices } from "./notices.svelte";
import { live } from "./live.svelte";
import { addressOf, type Header, type Message } from "../protocol";

const RENEW = 50; // ms between two renewals
const HOLD = 0.2; // seconds that the server repeats without one
const running = new Set<Repeat>();

/** What repeats this message to this device ends without a safe value: another value of it is sent now. */
export function giveWay(message: Message, header: Header | undefined, to: Repeat | null = null): void {
  for (const one of [...running]) if (one !== to && one.isOf(message, header)) one.giveWay();
}

export class Repeat {
  isOn = $state(false);
  private timer: ReturnType<typeof setInterval> | null = null;
  private values: Record<string, unknown> = {};
  private header: Header | undefined;
  private message: Message | null = null;
  private waits = 0;
  private isPatient = false;

  /** Begins, or changes the repeated values. Without an `every` in the file the page sends each `every_ms` itself.
   *  `isPatient`: goes on when the network was late; only for values that stop the robot. */
  set(
    message: Message,
    values: Record<string, unknown>,
    every_ms = RENEW,
    header?: Header,
    { isPatient = false } = {},
  ): void {
    if (!this.isOf(message, header)) this.end(); // another device's values are not continued
    giveWay(message, header, this);
    this.isPatient = isPatient;
    this.values = values;
    this.header = header;
    if (this.isOn) {
      this.renew();
      return;
    }
    this.message = message;
    this.isOn = true;
    running.add(this);
    this.waits = 0;
    this.renew();
    this.timer = setInterval(() => this.renew(), message.every === null ? every_ms : RENEW);
  }

  /** Ends with the safe value. Safe to call at any time. */
  end(): void {
    if (!this.isOn) return;
    const message = this.message;
    this.drop();
    if (message?.is_controlled && session.control.yours)
      void session.endSafely(message.name, this.address()).catch((error: Error) => notices.say(error.message, "bad"));
    else if (message && !message.is_controlled && message.every !== null)
      void session.ask("stop_repeating", { message: message.name }).catch(() => {});
  }

  isOf(message: Message, header: Header | undefined): boolean {
    return this.message?.name === message.name && this.address() === addressOf(live.protocol, header ?? {});
  }

  /** Ends without a safe value. The server's lease would otherwise send the old value on for `HOLD`. */
  giveWay(): void {
    const message = this.message;
    const address = this.address();
    this.drop();
    if (message && message.every !== null)
      void session.ask("stop_repeating", { message: message.name, address }).catch(() => {});
  }

  private drop(): void {
    this.isOn = false;
    running.delete(this);
    if (this.timer) clearInterval(this.timer);
    this.timer = null;
    this.message = null;
  }

  private address(): number | undefined {
    return addressOf(live.protocol, this.header ?? {});
  }

  private renew(): void {
    const message = this.message;
    if (!message || this.waits > 3) return; // the server is behind: the tick of each command would be old
    this.waits++;
    const sent =
      message.every === null
        ? session.send(message.name, this.values, this.header)
        : session.repeat(message.name, this.values, HOLD, this.header);
    sent.then(
      () => this.waits--,
      (error: Error) => {
        this.waits--;
        if (!this.isOn || (this.isPatient && error instanceof Refusal && error.word === "late")) return;
        notices.say(error.message, "bad");
        this.end();
      },
    );
  }
}
