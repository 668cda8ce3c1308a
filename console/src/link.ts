// The attach protocol of docs/server.md over a WebSocket: commands, requests, heartbeat, ticks. It shows nothing, and it
// never takes control by itself: neither at its first command nor after a reconnect or a silence.
import { LastingSocket, type Socket } from "./lasting";

export const BEAT_EVERY = 100; // ms, while this page is in control
export const OLDEST_TICK = 250; // ms: a command is not even sent when the server's newest tick is older
const ANSWER_WITHIN = 3000; // ms
const REPLY_WITHIN = 1; // seconds that the robot may take

/** `silent`: the connection is open, and nothing comes through it. */
export type Phase = "connecting" | "attached" | "silent" | "lost" | "refused";
export interface Control {
  holder: string | null;
  yours: boolean;
  why: string;
  /** The program that released the emergency stop, while no program has been in control since. */
  releasedBy: string | null;
}
export interface Welcome {
  client: number;
  protocol: string;
  hash: string;
  port: string;
  baud: number;
}
/** A refusal in words: by the server (`word` is one of docs/server.md), or by the page itself. */
export class Refusal extends Error {
  constructor(
    readonly word: string,
    text: string,
    readonly by = "", // of a stop: the program that stopped the robot
  ) {
    super(text);
  }
}
export interface Reply {
  name: string;
  fields: Record<string, unknown>;
}
export interface Listener {
  phase(phase: Phase, why: string): void;
  welcome(welcome: Welcome): void;
  control(control: Control): void;
  event(event: Record<string, unknown>): void;
}
/** What the page says itself, in the reader's language. */
export interface LinkTexts {
  notAttached(): string;
  staleTick(ms: number): string;
  noAnswer(what: string): string;
  late(what: string): string;
  /** The connection ended before the answer came. */
  lost(what: string): string;
  noReply(): string;
  /** What the server says in this message. */
  said(message: Record<string, unknown>): string;
}
/** What lets the robot move again: it must not act later than it was meant, so that it carries a tick. */
export type Decision = "take" | "release_stop";
const AGES: ReadonlySet<string> = new Set<Decision>(["take", "release_stop"]);

interface Waiting {
  what: string;
  resolve(value: unknown): void;
  reject(error: Refusal): void;
  timer: ReturnType<typeof setTimeout>;
}

/** Who is in control, as the server says it. */
interface Told {
  holder: string | null;
  yours: boolean;
  released_by: string | null;
}
const isLate = (error: unknown) => error instanceof Refusal && error.word === "late";

export class AttachLink {
  phase: Phase = "connecting";
  hasControl = false;
  private readonly socket: LastingSocket;
  private tick = 0;
  private tickAt = -Infinity;
  private next = 1;
  private beat: ReturnType<typeof setInterval> | null = null;
  private ended = false;
  private readonly answers = new Map<number, Waiting>();
  private readonly replies = new Map<number, Waiting>();
  private readonly onTick = new Set<() => void>();
  private losses = 0; // of the connection
  private readonly offsets = new Map<number, number>(); // of a reply that is announced: which request it answers

  constructor(
    make: () => Socket,
    private readonly token: () => string,
    private readonly name: string,
    private readonly listener: Listener,
    private readonly texts: LinkTexts,
    private readonly now: () => number = () => performance.now(),
  ) {
    const on = {
      opened: () => this.attach(),
      message: (data: unknown) => {
        if (typeof data === "string") this.take(JSON.parse(data) as Record<string, unknown>);
      },
      silent: (isSilent: boolean) => this.silent(isSilent),
      lost: (reason: string) => this.lost(reason),
    };
    this.socket = new LastingSocket(make, on, now);
  }

  connect(): void {
    this.enter("connecting", "");
    this.socket.connect();
  }

  /** Ends the connection in order: the server sends the safe values of this page's repeated messages. */
  end(): void {
    this.ended = true;
    if (this.phase === "attached") this.write({ do: "leave", id: this.next++ });
    this.dropAll();
    this.socket.end();
  }

  /** Milliseconds since the server's last tick came. */
  tickAge(): number {
    return this.now() - this.tickAt;
  }

  /** One request of docs/server.md. Rejects with a `Refusal`. */
  ask(what: string, keys: Record<string, unknown> = {}): Promise<unknown> {
    if (this.phase !== "attached") return Promise.reject(new Refusal("down", this.texts.notAttached()));
    return this.answered(this.next++, what, AGES.has(what) ? { ...keys, tick: this.tick } : keys);
  }

  /** What a person decided. If the server or the network stalled and it came too late, it is sent once more with a new
   *  tick, on the same connection, and only if `isMeant` still says so. */
  async decide(what: Decision, keys: Record<string, unknown>, isMeant: () => boolean): Promise<unknown> {
    try {
      return await this.onceMore(() => this.ask(what, keys), isMeant);
    } catch (error) {
      throw isLate(error) ? new Refusal("late", this.texts.late(what)) : error;
    }
  }

  /** Tries it, and where that was too late once more with the next tick, on the same connection. */
  private async onceMore<Answer>(ask: () => Promise<Answer>, isMeant: () => boolean): Promise<Answer> {
    const losses = this.losses;
    try {
      return await ask();
    } catch (error) {
      if (!isLate(error)) throw error;
      await this.nextTick();
      if (losses !== this.losses || !isMeant()) throw error;
      return ask();
    }
  }

  /** A message that may move the robot. It carries the newest tick, and does not leave when that is old. */
  command(what: "send" | "repeat", keys: Record<string, unknown>): Promise<unknown> {
    const age = this.tickAge();
    if (this.phase === "attached" && age > OLDEST_TICK)
      return Promise.reject(new Refusal("late", this.texts.staleTick(Math.round(age))));
    return this.ask(what, { ...keys, tick: this.tick });
  }

  /** A request to the robot, and its reply. It is sent once more if it came too late, like a person's decision. */
  request(message: string, fields: Record<string, unknown>, header?: Record<string, unknown>): Promise<Reply> {
    return this.onceMore(
      () => this.requestOnce({ message, fields, header, reply: REPLY_WITHIN }),
      () => true,
    );
  }

  private requestOnce(keys: { message: string } & Record<string, unknown>): Promise<Reply> {
    const id = this.next;
    const reply = new Promise<Reply>((resolve, reject) => {
      const timer = setTimeout(
        () => this.settle(this.replies, id)?.reject(new Refusal("no_reply", this.texts.noReply())),
        REPLY_WITHIN * 1000 + ANSWER_WITHIN,
      );
      this.replies.set(id, { what: keys.message, resolve: (value) => resolve(value as Reply), reject, timer });
    });
    this.command("send", keys).catch((error: Refusal) => this.settle(this.replies, id)?.reject(error));
    return reply;
  }

  /** Ahead of everything, by anyone, whatever the ticks say: also into a silent connection, because a stop is never too
   *  late. */
  stop(): Promise<unknown> {
    return this.phase === "silent" ? this.answered(this.next++, "emergency_stop", {}) : this.ask("emergency_stop");
  }

  private attach(): void {
    const first = { do: "attach", id: 0, version: 1, name: this.name, messages: "none", asks: true };
    this.write({ ...first, token: this.token() });
  }

  private answered(id: number, what: string, keys: Record<string, unknown>): Promise<unknown> {
    return new Promise((resolve, reject) => {
      const timer = setTimeout(
        () => this.settle(this.answers, id)?.reject(new Refusal("silent", this.texts.noAnswer(what))),
        ANSWER_WITHIN,
      );
      this.answers.set(id, { what, resolve, reject, timer });
      this.write({ do: what, id, ...keys });
    });
  }

  private take(message: Record<string, unknown>): void {
    if ("re" in message) {
      this.answer(message);
      return;
    }
    switch (message.event) {
      case "tick":
        this.tick = message.tick as number;
        this.tickAt = this.now();
        for (const wake of this.onTick) wake();
        return;
      case "control":
        this.setControl(message as Partial<Told>, (message.why as string) ?? "");
        return;
      case "reply":
        this.offsets.set(message.offset as number, message.request as number);
        return;
      case "no_reply":
        this.settle(this.replies, message.request as number)?.reject(new Refusal("no_reply", this.texts.said(message)));
        return;
      case "message": {
        const offset = message.offset as number;
        const request = this.offsets.get(offset);
        this.offsets.delete(offset);
        if (request !== undefined) this.settle(this.replies, request)?.resolve(message);
        return;
      }
      default:
        this.listener.event(message);
    }
  }

  private answer(message: Record<string, unknown>): void {
    const id = message.re as number;
    if (id === 0 && this.phase !== "attached") {
      if ("error" in message) {
        this.enter("refused", this.texts.said(message));
        this.ended = message.error === "token" || message.error === "version";
        if (this.ended) this.socket.stay();
        return;
      }
      const ok = message.ok as Welcome & { control: Partial<Told> & { is_own?: boolean } };
      this.tick = message.tick as number; // of decisions before the next one comes
      this.tickAt = this.now();
      this.socket.isGood();
      this.enter("attached", "");
      this.listener.welcome(ok);
      this.setControl({ yours: ok.control.is_own, ...ok.control }, "");
      return;
    }
    const waiting = this.settle(this.answers, id);
    if ("error" in message)
      waiting?.reject(new Refusal(message.error as string, this.texts.said(message), message.by as string | undefined));
    else waiting?.resolve(message.ok);
  }

  private setControl({ holder = null, yours = false, released_by = null }: Partial<Told>, why: string): void {
    this.hasControl = yours;
    if (!yours) this.endBeat();
    else if (!this.beat) {
      const beat = () => this.write({ do: "beat", tick: this.tick });
      this.beat = setInterval(beat, BEAT_EVERY);
      beat(); // the server has counted since it granted control, which may be a while ago
    }
    this.listener.control({ holder, yours, why, releasedBy: released_by });
  }

  /** Resolves when the next tick has come; at the latest when it should have. */
  private nextTick(): Promise<void> {
    return new Promise((resolve) => {
      const wake = () => {
        clearTimeout(timer);
        this.onTick.delete(wake);
        resolve();
      };
      const timer = setTimeout(wake, OLDEST_TICK);
      this.onTick.add(wake);
    });
  }

  private endBeat(): void {
    if (this.beat) clearInterval(this.beat);
    this.beat = null;
  }

  /** The server ends the control of a page that it does not hear; a page that hears nothing must not count on it. */
  private silent(isSilent: boolean): void {
    if (this.phase !== "attached" && this.phase !== "silent") return;
    this.enter(isSilent ? "silent" : "attached", "");
    if (isSilent && this.hasControl) this.setControl({}, "unheard");
  }

  private lost(reason: string): void {
    this.losses++;
    this.dropAll();
    if (this.hasControl || this.beat) this.setControl({}, "connection");
    if (!this.ended || this.phase !== "refused") this.enter("lost", reason);
  }

  private dropAll(): void {
    for (const from of [this.answers, this.replies])
      for (const id of [...from.keys()]) {
        const waiting = this.settle(from, id);
        waiting?.reject(new Refusal("down", this.texts.lost(waiting.what)));
      }
    this.offsets.clear();
    this.endBeat();
  }

  private settle(from: Map<number, Waiting>, id: number): Waiting | undefined {
    const waiting = from.get(id);
    if (waiting) clearTimeout(waiting.timer);
    from.delete(id);
    return waiting;
  }

  private enter(phase: Phase, why: string): void {
    this.phase = phase;
    this.listener.phase(phase, why);
  }

  private write(message: Record<string, unknown>): void {
    this.socket.say(message);
  }
}
