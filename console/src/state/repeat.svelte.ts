// A value that is renewed while somebody wants it, and ends with its safe value when not. The server's lease is short: a
// page that is gone renews nothing, and the robot stops by itself.
import { session } from "./session.svelte";
import { notices } from "./notices.svelte";
import { live } from "./live.svelte";
import { addressOf, type Header, type Message } from "../protocol";

const RENEW = 50; // ms between two renewals
const HOLD = 0.2; // seconds that the server repeats without one

export class Repeat {
  isOn = $state(false);
  private timer: ReturnType<typeof setInterval> | null = null;
  private values: Record<string, unknown> = {};
  private header: Header | undefined;
  private message: Message | null = null;
  private waits = 0;

  /** Begins, or changes what is repeated. Without an `every` in the file the page sends each `every_ms` itself. */
  set(message: Message, values: Record<string, unknown>, every_ms = RENEW, header?: Header): void {
    const isSame = this.message?.name === message.name && this.address() === addressOf(live.protocol, header ?? {});
    if (!isSame) this.end(); // what another device was sent does not go on
    this.values = values;
    this.header = header;
    if (this.isOn) {
      this.renew();
      return;
    }
    this.message = message;
    this.isOn = true;
    this.waits = 0;
    this.renew();
    this.timer = setInterval(() => this.renew(), message.every === null ? every_ms : RENEW);
  }

  /** Ends with the safe value. Safe to call at any time. */
  end(): void {
    if (!this.isOn) return;
    this.isOn = false;
    if (this.timer) clearInterval(this.timer);
    this.timer = null;
    const message = this.message;
    this.message = null;
    if (message?.is_controlled && session.control.yours)
      void session.endSafely(message.name, this.address()).catch((error: Error) => notices.say(error.message, "bad"));
    else if (message && !message.is_controlled && message.every !== null)
      void session.ask("stop_repeating", { message: message.name }).catch(() => {});
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
        notices.say(error.message, "bad");
        this.end();
      },
    );
  }
}
