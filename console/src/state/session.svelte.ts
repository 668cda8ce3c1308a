// The page's one connection for commands, as the views read it: are we attached, who is in control, what was refused.
import { AttachLink, Refusal, type Control, type Phase, type Reply, type Welcome } from "../link";
import { address } from "../http";
import type { Header } from "../protocol";
import { notices } from "./notices.svelte";
import { place } from "./place.svelte";
import { words } from "./words.svelte";

class Session {
  phase = $state<Phase>("connecting");
  why = $state("");
  welcome = $state.raw<Welcome | null>(null);
  control = $state.raw<Control>({ holder: null, yours: false, why: "" });
  events = $state.raw<{ at: number; event: Record<string, unknown> }[]>([]);
  readonly name = `console ${Math.floor(Math.random() * 0xfff)
    .toString(16)
    .padStart(3, "0")}`;
  private readonly onLoss = new Set<() => void>();
  private readonly link = new AttachLink(
    () => new WebSocket(address("attach", "ws")),
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
      noAnswer: (what) => words.t.link.noAnswer(what),
      noReply: () => words.t.link.noReply,
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

  async take(over = false): Promise<void> {
    await this.attempt(this.link.ask("take", { over }));
  }

  async release(): Promise<void> {
    await this.attempt(this.link.ask("release"));
  }

  async stop(): Promise<void> {
    await this.attempt(this.link.stop());
  }

  async releaseStop(): Promise<void> {
    await this.attempt(this.link.ask("release_stop"));
  }

  /** Waits for it; a refusal becomes a notice. True: it was done. */
  async attempt(doing: Promise<unknown>): Promise<boolean> {
    try {
      await doing;
      return true;
    } catch (error) {
      notices.say(error instanceof Refusal ? error.message : String(error), "bad");
      return false;
    }
  }

  private setControl(control: Control): void {
    const had = this.control.yours;
    this.control = control;
    if (!had || control.yours) return;
    for (const callback of this.onLoss) callback();
    const why = words.t.top.controlLost[control.why];
    if (why) notices.say(why, "bad");
  }
}
export const session = new Session();
