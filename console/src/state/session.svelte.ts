// The page's one connection for commands, as the views read it: attached or not, who is in control, refusals.
import { AttachLink, Refusal, type Control, type Decision, type Phase, type Reply, type Welcome } from "../link";
import { host } from "../host";
import type { Header } from "../protocol";
import { live } from "./live.svelte";
import { notices } from "./notices.svelte";
import { place } from "./place.svelte";
import { said, words } from "./words.svelte";

const RETRY_STOP = 100; // ms
const MEANT_FOR = 2000; // ms after a press, in which it is sent again if it came too late
const NOT_HEARD = new Set(["down", "silent"]); // refusals of a stop that did not reach a link: it is sent again

/** A stop that the server has not confirmed. */
export interface Stopping {
  since: number; // performance.now()
  wasSent: boolean; // into a connection; else there was none
}

class Session {
  phase = $state<Phase>("connecting");
  why = $state("");
  welcome = $state.raw<Welcome | null>(null);
  control = $state.raw<Control>({ holder: null, yours: false, why: "", releasedBy: null });
  stopping = $state.raw<Stopping | null>(null);
  events = $state.raw<{ at: number; event: Record<string, unknown> }[]>([]);
  readonly name = `console ${Math.floor(Math.random() * 0xfff)
    .toString(16)
    .padStart(3, "0")}`;
  private stops = 0; // presses
  private readonly onLoss = new Set<() => void>();
  private readonly link = new AttachLink(
    () => host.now.socket("attach"),
    () => place.token,
    this.name,
    {
      phase: (phase, why) => {
        this.phase = phase;
        this.why = why;
      },
      welcome: (welcome) => {
        this.welcome = welcome;
      },
      control: (control) => this.setControl(control),
      event: () => {},
    },
    {
      notAttached: () => words.t.link.notAttached,
      staleTick: (ms) => words.t.link.staleTick(ms),
      noAnswer: (what) => words.t.link.noAnswer(words.t.link.acts[what] ?? what),
      late: (what) => words.t.link.tooLate(words.t.link.acts[what] ?? what),
      lost: (what) => words.t.link.lost(words.t.link.acts[what] ?? what),
      noReply: () => words.t.link.noReply,
      said: (message) => said(message, "text"),
    },
  );

  start(): void {
    this.link.connect();
    // A hidden tab cannot see the robot, and browsers slow its timers down: it gives control up in order.
    document.addEventListener("visibilitychange", () => {
      if (document.hidden && this.control.yours) void this.release();
    });
    addEventListener("pagehide", () => this.link.end());
    addEventListener("pageshow", (event) => {
      if (event.persisted) location.reload();
    });
  }

  /** Calls back whenever this page is not in control any more. Returns how to end that. */
  whenLost(callback: () => void): () => void {
    this.onLoss.add(callback);
    return () => this.onLoss.delete(callback);
  }

  send = (message: string, fields: Record<string, unknown>, header?: Header) =>
    this.link.command("send", { message, fields, header });
  repeat = (message: string, fields: Record<string, unknown>, hold: number, header?: Header) =>
    this.link.command("repeat", { message, fields, hold, header });
  endSafely = (message: string, address?: number) => this.link.ask("end_safely", { message, address });
  ask = (what: string, keys: Record<string, unknown> = {}) => this.link.ask(what, keys);
  request = (message: string, fields: Record<string, unknown>, header?: Header): Promise<Reply> =>
    this.link.request(message, fields, header);

  /** `over`: the program that loses control; the server refuses where another one has it by then. A press is a person's
   *  decision, so that it also takes control after another program released the emergency stop. */
  async take(over: string | false = false): Promise<void> {
    const first = this.control.releasedBy;
    const taking = this.decide("take", { over: over || first || false }).catch((error: unknown) => {
      const { holder, releasedBy } = this.control; // the release came to the server before the press, and to this page now
      const wasInTime = error instanceof Refusal && error.word === "not_in_control"; // "late": it is not meant any more
      if (over || !wasInTime || holder !== null || releasedBy === null || releasedBy === first) throw error;
      return this.decide("take", { over: releasedBy });
    });
    await this.attempt(taking);
  }

  /** Ends the emergency stop. If another program stopped the robot, nothing is released, and that program is returned:
   *  `over` it, it is a second decision. */
  async releaseStop(over: string | false = false): Promise<string | null> {
    try {
      await this.decide("release_stop", { over });
    } catch (error) {
      if (error instanceof Refusal && error.word === "stopped_by_other") return error.by;
      notices.say(error instanceof Error ? error.message : String(error), "bad");
    }
    return null;
  }

  /** A decision that comes too late is sent once more, unless the person may think otherwise by then. */
  private decide(what: Decision, keys: Record<string, unknown>): Promise<unknown> {
    const at = performance.now();
    const facts = () =>
      JSON.stringify([this.control.holder, this.control.releasedBy, live.stopped, live.link?.stopped_by, this.stops]);
    const before = facts();
    return this.link.decide(
      what,
      keys,
      () => performance.now() - at < MEANT_FOR && !document.hidden && facts() === before,
    );
  }

  async release(): Promise<void> {
    await this.attempt(this.link.ask("release"));
  }

  /** The emergency stop. It is sent again until the server has latched it, over whatever connection there is by then. */
  async stop(): Promise<void> {
    if (this.stopping) return; // it is under way
    const none = live.protocol?.emergency_stop.length === 0;
    if (none || live.link?.connected === false) {
      notices.say(none ? words.t.stop.none : words.t.stop.noPort, "bad");
      return;
    }
    this.stops++;
    const since = performance.now();
    this.stopping = { since, wasSent: false };
    while (this.stopping?.since === since) {
      const wasSent: boolean = this.stopping.wasSent || this.phase === "attached" || this.phase === "silent";
      if (wasSent !== this.stopping.wasSent) this.stopping = { since, wasSent };
      try {
        await this.link.stop();
        this.endStopping(since);
      } catch (error) {
        if (!(error instanceof Refusal) || !NOT_HEARD.has(error.word)) {
          this.endStopping(since);
          notices.say(error instanceof Error ? error.message : String(error), "bad");
        } else await new Promise((wake) => setTimeout(wake, RETRY_STOP));
      }
    }
  }

  /** Ends the attempts of `stop`. What was sent may still arrive. */
  giveUpStop(): void {
    this.stopping = null;
  }

  private endStopping(since: number): void {
    if (this.stopping?.since === since) this.stopping = null;
  }

  /** Waits for it; a refusal becomes a notice. True: it was done. */
  async attempt(doing: Promise<unknown>): Promise<boolean> {
    try {
      await doing;
      return true;
    } catch (error) {
      notices.say(error instanceof Error ? error.message : String(error), "bad");
      return false;
    }
  }

  private setControl(control: Control): void {
    const had = this.control.yours;
    this.control = control;
    if (!had || control.yours) return;
    for (const callback of this.onLoss) callback();
    const isShown = control.why === "emergency stop" && (live.stopped || this.stopping !== null); // by the banner
    const why = words.t.top.controlLost[control.why];
    if (why && !isShown) notices.say(why, "bad");
  }
}
export const session = new Session();
