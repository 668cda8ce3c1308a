// Commands to the robot, by the rules of docs/server.md: the page is the one client, and must be in control to move
// things. The page's thread may stall while this worker goes on, or the other way round: commands carry a tick, and a
// page that is not heard for a moment loses control.
import type { Clock } from "./clock";
import { EngineError } from "./engine";
import type { Question } from "./requests";
import { RefusedError, type Robot } from "./robot";
import { told } from "./source";

const TICK_EVERY = 0.05; // seconds
const OLDEST_COMMAND = 0.25; // seconds: a command from longer ago is refused
const SILENCE = 0.3; // seconds without a beat, after which the page is not in control any more
const STALLED = 0.05; // seconds without a look
const TICKS_KEPT = 64;
const LONGEST_REPLY = 3600; // seconds
const VERSION = 1;

type Asked = Record<string, unknown>;
/** What else a page can ask for, by the name of the request. */
export type Others = Record<string, (asked: Asked) => unknown>;

export class Desk {
  holder: string | null = null;
  private name = "";
  private isAttached = false;
  private mustAsk = false; // it lost control against its will: no command takes it by itself
  private beatAt = 0;
  private tick = 0;
  private readonly ticks = new Map<number, number>();
  private tickedAt = -Infinity;
  private judgedAt = 0;
  private readonly questions = new Map<number, { question: Question; timer: ReturnType<typeof setTimeout> }>();

  constructor(
    private readonly clock: Clock,
    private readonly robot: () => Robot | null,
    private readonly others: Others,
    private readonly say: (message: Record<string, unknown>) => void,
    /** The program that stopped the robot, perhaps before this page was loaded; null: no stop is latched. */
    public stoppedBy: string | null,
    /** Keeps that name for the next page; null: the stop is released. */
    private readonly keepStop: (by: string | null) => void,
  ) {}

  get isPresent(): boolean {
    return this.isAttached;
  }

  /** One message of the page. */
  take(message: Asked): void {
    const now = this.clock.now();
    if (now - this.judgedAt > STALLED) this.judge(now); // waiting commands may be from before a stall
    const id = message.id as number;
    if (!this.isAttached) {
      if (message.do === "attach") this.attach(id, message.name as string);
      else this.say({ re: id, error: "attach_first", text: 'the first message must be {"do": "attach"}' });
      return;
    }
    if (message.do === "beat") {
      if (this.age(message.tick as number) <= OLDEST_COMMAND) this.beatAt = now;
      return;
    }
    try {
      Promise.resolve(this.do(message)).then(
        (ok) => this.say({ re: id, ok: ok ?? null }),
        (error: Error) => this.say({ re: id, ...refusal(error) }),
      );
    } catch (error) {
      this.say({ re: id, ...refusal(error as Error) });
    }
  }

  /** Call it 50 times a second. */
  look(): void {
    const now = this.clock.now();
    this.judge(now);
    if (now - this.tickedAt < TICK_EVERY) return;
    this.tickedAt = now;
    this.ticks.set(++this.tick, now);
    this.ticks.delete(this.tick - TICKS_KEPT);
    if (this.isAttached) this.say({ event: "tick", tick: this.tick });
  }

  /** The page has gone, or says so. */
  leave(): void {
    if (!this.isAttached) return;
    this.isAttached = false;
    for (const number of [...this.questions.keys()]) this.withdraw(number);
    this.robot()?.endMotion();
    this.endControl("gone");
  }

  /** The link is another one, or closed: no page is in control. */
  forget(): void {
    this.endControl("released");
    for (const number of [...this.questions.keys()]) this.withdraw(number);
  }

  // ---- who is in control

  private attach(id: number, name: string): void {
    this.isAttached = true;
    this.name = name;
    this.mustAsk = this.stoppedBy !== null;
    const robot = this.robot();
    const control = { holder: this.holder, is_own: false, released_by: null };
    const ok = {
      version: VERSION,
      server: "wirebond page",
      client: 1,
      protocol: robot?.facts.protocol.name ?? "",
      hash: robot?.facts.protocol.hash ?? "",
      port: robot?.portName ?? "",
      baud: robot?.baud ?? 0,
      role: "host",
      control,
    };
    this.say({ re: id, ok, t: this.clock.now(), tick: this.tick });
  }

  private judge(now: number): void {
    this.judgedAt = now;
    if (this.holder !== null && now - this.beatAt > SILENCE) {
      this.robot()?.endMotion();
      this.mustAsk = true;
      this.endControl("silent");
    }
  }

  /** Seconds since the tick after this one was due: the page's state is at least that old. */
  private age(tick: number): number {
    if (this.tick === 0) return 0;
    const made = this.ticks.get(tick);
    if (tick === 0 && this.tick < TICKS_KEPT) return Math.max(0, this.clock.now() - this.ticks.get(1)!);
    return made === undefined ? Infinity : Math.max(0, this.clock.now() - made - TICK_EVERY);
  }

  private mustBeNew(tick: unknown): void {
    if (typeof tick === "number" && this.age(tick) <= OLDEST_COMMAND) return;
    throw new RefusedError(
      "late",
      `the command was under way for more than ${OLDEST_COMMAND} s; send it again if it is still wanted`,
    );
  }

  private takeControl(): void {
    this.holder = this.name;
    this.mustAsk = false;
    this.beatAt = this.clock.now();
    this.tellControl("taken");
  }

  private endControl(why: string): void {
    if (this.holder === null) return;
    this.holder = null;
    this.tellControl(why);
  }

  private tellControl(why: string): void {
    this.robot()?.note("control", { holder: this.holder, why });
    if (!this.isAttached) return;
    this.say({ event: "control", holder: this.holder, yours: this.holder !== null, released_by: null, why });
  }

  // ---- requests

  private do(asked: Asked): unknown {
    const what = asked.do as string;
    const other = this.others[what];
    if (other) return other(asked);
    if (what === "leave") {
      this.leave();
      return "left";
    }
    const robot = this.robot();
    if (!robot) throw new RefusedError("down", "no port is connected; choose one first");
    const message = asked.message as string;
    switch (what) {
      case "send":
      case "repeat":
        return this.command(robot, asked, what === "repeat" ? (asked.hold as number) : 0);
      case "stop_repeating":
        return robot.stopRepeating(message, (asked.address as number | undefined) ?? null);
      case "end_safely":
        return robot.endSafely(message, (asked.address as number | undefined) ?? 0);
      case "hand_over":
        return robot.handOver();
      case "take":
        this.mustBeNew(asked.tick);
        if (this.holder === null) this.takeControl();
        else this.tellControl("taken");
        return null;
      case "release":
        if (this.holder !== null) {
          robot.endMotion();
          this.mustAsk = false;
          this.endControl("released");
        }
        return null;
      case "emergency_stop":
        if (robot.facts.stops.length === 0) {
          throw new RefusedError(
            "refused",
            "the protocol file has no `emergency_stop`; add it, or use the robot's switch",
          );
        }
        robot.stop();
        this.setStopped(this.name);
        this.mustAsk = true;
        this.endControl("emergency stop");
        return null;
      case "release_stop":
        this.mustBeNew(asked.tick);
        if (this.stoppedBy !== null && ![this.name, asked.over].includes(this.stoppedBy) && asked.over !== true) {
          throw new StoppedByOtherError(this.stoppedBy);
        }
        robot.releaseStop();
        this.setStopped(null);
        this.mustAsk = false;
        return null;
      case "recover":
        return robot.recover(asked.action as number);
      case "withdraw":
        return this.withdraw(asked.request as number);
      case "mark":
        return robot.note("mark", { text: asked.text, by: this.name });
      case "ask":
        return { state: robot.state, why: robot.why, stopped: robot.isStopped, struck: robot.struck() }[
          asked.what as string
        ];
    }
    throw new RefusedError("not_understood", `a page does not have the request ${what}; use \`wirebond serve\` for it`);
  }

  private setStopped(by: string | null): void {
    this.stoppedBy = by;
    this.keepStop(by);
  }

  private command(robot: Robot, asked: Asked, hold: number): unknown {
    const name = asked.message as string;
    const index = robot.indexOf(name);
    const model = robot.facts.protocol.messages[index]!;
    const fields = withBytes(asked.fields as Record<string, unknown>, model.fields);
    const header = (asked.header as Record<string, unknown> | undefined) ?? {};
    if (model.is_controlled) this.mayCommand(robot, name, asked.tick);
    const leave = () => robot.send(name, fields, header, hold);
    if (model.reply === null || hold > 0) return leave();
    const waits = typeof asked.reply === "number";
    const number = asked.id as number;
    const finish = (outcome: Parameters<NonNullable<Question["finish"]>>[0]) => {
      clearTimeout(this.questions.get(number)?.timer);
      this.questions.delete(number);
      if ("error" in outcome) {
        this.say({ event: "no_reply", request: number, text: outcome.error.message });
        return;
      }
      const { t, offset, name: reply } = outcome.reply;
      this.say({ event: "reply", request: number, offset: Number(offset) });
      this.say({ event: "message", t, offset: Number(offset), name: reply, ...told(outcome.reply) });
    };
    const submitted = this.clock.now();
    const leaveInTime = () => {
      if (model.is_controlled && (this.holder === null || this.clock.now() - submitted > OLDEST_COMMAND)) {
        throw new RefusedError("late", `${name} waited for the replies to others; send it again if it is still wanted`);
      }
      leave();
    };
    const address = robot.facts.address.place === null ? null : robot.addressOf(name, index, header);
    const values = robot.asOnWire(index, fields, header);
    const question = robot.requests.question(name, values, address, leaveInTime, waits ? finish : null);
    if (waits) {
      const seconds = Math.min(asked.reply as number, LONGEST_REPLY);
      const timer = setTimeout(() => {
        this.withdraw(number);
        this.say({ event: "no_reply", request: number, text: this.noReply(robot, question, seconds) });
      }, 1000 * seconds);
      this.questions.set(number, { question, timer });
    }
    try {
      robot.requests.submit(question);
    } catch (error) {
      clearTimeout(this.questions.get(number)?.timer);
      this.questions.delete(number);
      throw error;
    }
    return null;
  }

  private mayCommand(robot: Robot, name: string, tick: unknown): void {
    if (robot.isStopped && robot.facts.stops.some((stop) => stop.message === name)) {
      throw new RefusedError("stopped", `${name} was not sent: the emergency stop holds; release it first`);
    }
    this.mustBeNew(tick);
    if (this.holder !== null) return;
    if (this.mustAsk) {
      throw new RefusedError(
        "not_in_control",
        "this page has lost control of the robot; take control to have it again",
      );
    }
    this.takeControl();
  }

  private withdraw(number: number): void {
    const waiting = this.questions.get(number);
    if (!waiting) return;
    clearTimeout(waiting.timer);
    this.questions.delete(number);
    this.robot()?.requests.withdraw(waiting.question);
  }

  private noReply(robot: Robot, { message, reply }: Question, seconds: number): string {
    const advice = {
      down: "The port is not connected at the moment; plug it in",
      stale: "Nothing at all comes; check the cable, the baud rate, and that the MCU runs",
      up: `Check that the MCU answers ${message}`,
    }[robot.state];
    return `no ${reply} within ${seconds} s of ${message}. ${advice}`;
  }
}

/** Another page stopped the robot: releasing that stop is a second decision. */
class StoppedByOtherError extends RefusedError {
  constructor(readonly by: string) {
    super("stopped_by_other", `${by} stopped the robot; look at the robot, then release the stop`);
  }
}

function refusal(error: Error): { error: string; text: string; by?: string } {
  if (error instanceof StoppedByOtherError) return { error: error.word, text: error.message, by: error.by };
  if (error instanceof RefusedError) return { error: error.word, text: error.message };
  if (error instanceof EngineError && error.kind === "message") return { error: "message", text: error.message };
  return { error: "refused", text: error.message };
}

/** Bytes come as digits. */
function withBytes(
  values: Record<string, unknown>,
  fields: { name: string; kind: string; fields: unknown }[],
): Record<string, unknown> {
  const forms = new Map(fields.map((field) => [field.name, field]));
  const one = (value: unknown, form: { kind: string; fields: unknown } | undefined): unknown => {
    if (Array.isArray(value)) return value.map((each) => one(each, form));
    if (form?.kind === "bytes" && typeof value === "string") return bytesOf(value);
    if (form?.kind === "struct" && value !== null && typeof value === "object") {
      return withBytes(value as Record<string, unknown>, form.fields as Parameters<typeof withBytes>[1]);
    }
    return value;
  };
  return Object.fromEntries(Object.entries(values).map(([name, value]) => [name, one(value, forms.get(name))]));
}

/** The bytes of hexadecimal digits. Throws a `RefusedError`. */
export function bytesOf(digits: string): Uint8Array {
  const text = digits.replace(/\s/g, "");
  if (!/^([0-9a-f]{2})*$/i.test(text)) {
    throw new RefusedError("message", `${digits.slice(0, 40)} are not bytes; write two hexadecimal digits for each`);
  }
  return Uint8Array.from(text.match(/../g) ?? [], (pair) => parseInt(pair, 16));
}
