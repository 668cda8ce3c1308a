// The attach protocol of docs/server.md over a WebSocket: commands, requests, heartbeat, ticks. It shows nothing, and it
// never takes control by itself: neither at its first command nor after a reconnect.

export const BEAT_EVERY = 100; // ms, while this page is in control
export const OLDEST_TICK = 250; // ms: a command is not even sent when the server's newest tick is older
const LONGEST_WAIT = 2000; // ms between two attempts to connect
const ANSWER_WITHIN = 3000; // ms
const REPLY_WITHIN = 1; // seconds that the robot may take

export type Phase = "connecting" | "attached" | "lost" | "refused";
export interface Control {
  holder: string | null;
  yours: boolean;
  why: string;
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
  noReply(): string;
}
type Socket = Pick<WebSocket, "send" | "close" | "readyState"> & {
  onopen: ((event: never) => void) | null;
  onmessage: ((event: never) => void) | null;
  onclose: ((event: never) => void) | null;
};
interface Waiting {
  resolve(value: unknown): void;
  reject(error: Refusal): void;
  timer: ReturnType<typeof setTimeout>;
}

export class AttachLink {
  phase: Phase = "connecting";
  hasControl = false;
  private socket: Socket | null = null;
  private tick = 0;
  private tickAt = -Infinity;
  private next = 1;
  private wait = 250;
  private beat: ReturnType<typeof setInterval> | null = null;
  private again: ReturnType<typeof setTimeout> | null = null;
  private ended = false;
  private readonly answers = new Map<number, Waiting>();
  private readonly replies = new Map<number, Waiting>();
  private readonly offsets = new Map<number, number>(); // of a reply that is announced: which request it answers

  constructor(
    private readonly make: () => Socket,
    private readonly token: () => string,
    private readonly name: string,
    private readonly listener: Listener,
    private readonly texts: LinkTexts,
    private readonly now: () => number = () => performance.now(),
  ) {}

  connect(): void {
    if (this.ended) return;
    if (this.phase !== "lost") this.enter("connecting", "");
    const socket = this.make();
    this.socket = socket;
    socket.onopen = () => {
      if (socket !== this.socket) return;
      const first = { do: "attach", id: 0, version: 1, name: this.name, messages: "none", asks: true };
      socket.send(JSON.stringify({ ...first, token: this.token() }));
    };
    socket.onmessage = (event: never) => {
      const data = (event as MessageEvent).data;
      if (socket === this.socket && typeof data === "string") this.take(JSON.parse(data) as Record<string, unknown>);
    };
    socket.onclose = (event: never) => {
      if (socket === this.socket) this.lost((event as CloseEvent).reason ?? "");
    };
  }

  /** Ends the connection in order: the server sends the safe values of what this page repeated. */
  end(): void {
    this.ended = true;
    if (this.again) clearTimeout(this.again);
    if (this.phase === "attached") this.write({ do: "leave", id: this.next++ });
    this.dropAll(this.texts.notAttached());
    this.socket?.close();
    this.socket = null;
  }

  /** Milliseconds since the server's last tick came. */
  tickAge(): number {
    return this.now() - this.tickAt;
  }

  /** One request of docs/server.md. Rejects with a `Refusal`. */
  ask(what: string, keys: Record<string, unknown> = {}): Promise<unknown> {
    if (this.phase !== "attached") return Promise.reject(new Refusal("down", this.texts.notAttached()));
    return this.answered(this.next++, what, keys);
  }

  /** A message that may move the robot. It carries the newest tick, and does not leave when that is old. */
  command(what: "send" | "repeat", keys: Record<string, unknown>): Promise<unknown> {
    const age = this.tickAge();
    if (this.phase === "attached" && age > OLDEST_TICK)
      return Promise.reject(new Refusal("late", this.texts.staleTick(Math.round(age))));
    return this.ask(what, { ...keys, tick: this.tick });
  }

  /** A request to the robot, and its reply. */
  request(message: string, fields: Record<string, unknown>, header?: Record<string, unknown>): Promise<Reply> {
    const id = this.next;
    const reply = new Promise<Reply>((resolve, reject) => {
      const timer = setTimeout(
        () => this.settle(this.replies, id)?.reject(new Refusal("no_reply", this.texts.noReply())),
        REPLY_WITHIN * 1000 + ANSWER_WITHIN,
      );
      this.replies.set(id, { resolve: (value) => resolve(value as Reply), reject, timer });
    });
    this.command("send", { message, fields, header, reply: REPLY_WITHIN }).catch((error: Refusal) =>
      this.settle(this.replies, id)?.reject(error),
    );
    return reply;
  }

  /** Ahead of everything, by anyone, whatever the ticks say. */
  stop(): Promise<unknown> {
    return this.ask("emergency_stop");
  }

  private answered(id: number, what: string, keys: Record<string, unknown>): Promise<unknown> {
    return new Promise((resolve, reject) => {
      const timer = setTimeout(
        () => this.settle(this.answers, id)?.reject(new Refusal("silent", this.texts.noAnswer(what))),
        ANSWER_WITHIN,
      );
      this.answers.set(id, { resolve, reject, timer });
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
        return;
      case "control":
        this.setControl(message.holder as string | null, message.yours as boolean, (message.why as string) ?? "");
        return;
      case "reply":
        this.offsets.set(message.offset as number, message.request as number);
        return;
      case "no_reply":
        this.settle(this.replies, message.request as number)?.reject(new Refusal("no_reply", message.text as string));
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
        this.enter("refused", message.text as string);
        this.ended = message.error === "token" || message.error === "version";
        return;
      }
      const ok = message.ok as Welcome & { control: Control & { is_own?: boolean }; tick: number };
      this.tick = ok.tick;
      this.tickAt = this.now();
      this.wait = 250;
      this.enter("attached", "");
      this.listener.welcome(ok);
      this.setControl(ok.control.holder, ok.control.yours ?? ok.control.is_own ?? false, "");
      return;
    }
    const waiting = this.settle(this.answers, id);
    if ("error" in message) waiting?.reject(new Refusal(message.error as string, message.text as string));
    else waiting?.resolve(message.ok);
  }

  private setControl(holder: string | null, yours: boolean, why: string): void {
    this.hasControl = yours;
    if (yours && !this.beat) this.beat = setInterval(() => this.write({ do: "beat", tick: this.tick }), BEAT_EVERY);
    if (!yours) this.endBeat();
    this.listener.control({ holder, yours, why });
  }

  private endBeat(): void {
    if (this.beat) clearInterval(this.beat);
    this.beat = null;
  }

  private lost(reason: string): void {
    this.socket = null;
    this.dropAll(this.texts.notAttached());
    if (this.hasControl || this.beat) this.setControl(null, false, "");
    if (this.ended) {
      if (this.phase !== "refused") this.enter("lost", reason);
      return;
    }
    this.enter("lost", reason);
    this.again = setTimeout(() => this.connect(), this.wait);
    this.wait = Math.min(this.wait * 2, LONGEST_WAIT);
  }

  private dropAll(text: string): void {
    for (const waiting of [this.answers, this.replies])
      for (const id of [...waiting.keys()]) this.settle(waiting, id)?.reject(new Refusal("down", text));
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
    if (this.socket?.readyState === 1) this.socket.send(JSON.stringify(message));
  }
}
