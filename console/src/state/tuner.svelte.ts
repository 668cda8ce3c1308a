// The parameters of one source: wanted, sent, acknowledged and read back.
import { isSame, refusal, type Parameter, type Source } from "../parameters";
import { Refusal, type Reply } from "../link";
import { live } from "./live.svelte";
import { session } from "./session.svelte";

export type ParameterState = "unknown" | "same" | "changed" | "sent" | "acknowledged" | "different" | "refused";
interface One {
  wanted: number;
  inForce: number | null;
  state: ParameterState;
  why: string;
}
type Values = Record<string, number>;
const RETRY_FIRST = 500; // ms after a failure to read; each further failure doubles it
const RETRY_LAST = 8000; // ms
const MOST_INDICES = 64; // that are tried of a table without names
const UNKNOWN: One = { wanted: 0, inForce: null, state: "unknown", why: "" };

export class Tuner {
  source = $state.raw<Source | null>(null);
  selected = $state<Values>({});
  sets = $state<Record<string, Values>>({});
  isBusy = $state(false);
  private wasRead = $state(false);
  private failures = 0; // of reading, since it was expected
  private isWaiting = $state(false); // after a failure
  private waiting: ReturnType<typeof setTimeout> | undefined;
  problem = $state("");
  /** When the last change was acknowledged, on the server's clock: a response begins there. */
  changedAt = $state<number | null>(null);
  private all = $state<Record<string, One>>({});
  private found = $state.raw<Parameter[]>([]); // of a table without names
  private protocol = "";

  readonly parameters = $derived(this.source?.parameters.length ? this.source.parameters : this.found);
  readonly hasChanges = $derived(
    this.parameters.some((parameter) => ["changed", "refused", "different"].includes(this.of(parameter).state)),
  );

  open(protocol: string, source: Source): void {
    if (this.source === source || (this.protocol === protocol && this.source?.name === source.name)) {
      this.source = source;
      return;
    }
    this.protocol = protocol;
    this.source = source;
    this.all = {};
    this.found = [];
    this.expectRead();
    this.problem = "";
    this.selected = Object.fromEntries(source.selectors.map((field) => [field.name, Math.max(0, field.min ?? 0)]));
    this.sets = JSON.parse(localStorage.getItem(this.key()) ?? "{}") as Record<string, Values>;
  }

  /** What was read says nothing any more: the robot may have started again, or may be another one. */
  expectRead(): void {
    this.wasRead = false;
    this.failures = 0;
    this.endWait();
  }

  /** Should the page read by itself? */
  get isDue(): boolean {
    return this.source !== null && !this.wasRead && !this.isBusy && !this.isWaiting;
  }

  of(parameter: Parameter): One {
    return this.all[this.place(parameter.key)] ?? UNKNOWN;
  }

  want(parameter: Parameter, wanted: number): void {
    if (!Number.isFinite(wanted)) return;
    const one = this.of(parameter);
    const state = one.inForce !== null && isSame(wanted, one.inForce, parameter.field.step) ? "same" : "changed";
    this.put(parameter, { ...one, wanted, state, why: "" });
  }

  select(name: string, value: number): void {
    if (!Number.isFinite(value)) return;
    this.selected = { ...this.selected, [name]: value };
    this.expectRead();
  }

  /** Ends of a slider: the file's range, otherwise around the current value. */
  rangeOf(parameter: Parameter): { low: number; high: number } {
    const { min, max } = parameter.field;
    if (min !== null && max !== null && max - min < 1e5) return { low: min, high: max };
    const size = Math.max(Math.abs(this.of(parameter).inForce ?? 0), 1e-3);
    const high = 10 ** Math.ceil(Math.log10(size * 2));
    return {
      low: Math.max(min ?? -Infinity, (this.of(parameter).inForce ?? 0) < 0 ? -high : 0),
      high: Math.min(max ?? Infinity, high),
    };
  }

  async readAll(): Promise<void> {
    const source = this.source;
    if (!source || this.isBusy) return;
    const selected = this.selected;
    const isRead = await this.busy(async () => {
      if (!source.read) return;
      if (!source.isService) {
        const reply = await session.request(source.read.name, { ...selected });
        if (this.selected === selected) this.takeFields(reply.fields);
        return;
      }
      if (source.parameters.length) for (const parameter of source.parameters) await this.readOne(parameter);
      else await this.discover(source);
    });
    if (this.selected !== selected) return; // it is read again, for the present selection
    if (isRead) this.wasRead = true;
    else this.waitAfterFailure();
  }

  async send(parameters: Parameter[]): Promise<void> {
    const source = this.source;
    if (!source || this.isBusy) return;
    await this.busy(async () => {
      // One message sets several values at once, where no name chooses among them.
      if (!source.isService && parameters.every((parameter) => Object.keys(parameter.selector).length === 0)) {
        const fields = Object.fromEntries(
          source.parameters.map((parameter) => [parameter.field.name, this.of(parameter).wanted]),
        );
        await this.set(source.parameters, { ...this.rest(), ...this.selected, ...fields });
        return;
      }
      for (const parameter of parameters)
        await this.set([parameter], {
          ...this.rest(),
          ...this.selected,
          ...parameter.selector,
          [parameter.field.name]: this.of(parameter).wanted,
        });
    });
  }

  sendChanges(): Promise<void> {
    return this.send(
      this.parameters.filter((parameter) => ["changed", "refused", "different"].includes(this.of(parameter).state)),
    );
  }

  /** What is wanted now, by name. */
  values(): Values {
    return Object.fromEntries(this.parameters.map((parameter) => [parameter.key, this.of(parameter).wanted]));
  }

  saveSet(name: string, values = this.values()): void {
    this.sets = { ...this.sets, [name]: values };
    localStorage.setItem(this.key(), JSON.stringify(this.sets));
  }

  removeSet(name: string): void {
    this.sets = Object.fromEntries(Object.entries(this.sets).filter(([other]) => other !== name));
    localStorage.setItem(this.key(), JSON.stringify(this.sets));
  }

  /** Wants the values of a set. They are sent by a further, deliberate act. */
  restore(name: string): void {
    for (const parameter of this.parameters) {
      const value = this.sets[name]?.[parameter.key];
      if (value !== undefined) this.want(parameter, value);
    }
  }

  private async set(parameters: Parameter[], fields: Record<string, unknown>): Promise<void> {
    const source = this.source!;
    for (const parameter of parameters) this.put(parameter, { ...this.of(parameter), state: "sent", why: "" });
    try {
      if (!source.set.reply) {
        await session.send(source.set.name, fields);
        return; // sent is all that is known
      }
      const reply = await session.request(source.set.name, fields);
      const answered = live.protocol?.messages.find((message) => message.name === source.set.reply) ?? null;
      const why = refusal(reply.fields, answered);
      this.changedAt = live.now();
      for (const parameter of parameters)
        this.put(parameter, {
          ...this.of(parameter),
          state: why === null ? "acknowledged" : "refused",
          why: why ?? "",
        });
      if (source.isService) this.takeOne(parameters[0]!, reply, why);
      else if (source.read)
        this.takeFields((await session.request(source.read.name, { ...this.selected })).fields, why);
      else if (source.value) this.takeFields(reply.fields, why); // the reply has the current value
    } catch (error) {
      for (const parameter of parameters)
        if (this.of(parameter).state === "sent")
          this.put(parameter, {
            ...this.of(parameter),
            state: "refused",
            why: error instanceof Error ? error.message : "",
          });
      throw error;
    }
  }

  private async readOne(parameter: Parameter): Promise<string | null> {
    const reply = await session.request(this.source!.read!.name, { ...parameter.selector });
    const why = refusal(reply.fields, this.source!.value);
    if (why === null) this.takeOne(parameter, reply, null);
    else this.put(parameter, { ...this.of(parameter), state: "refused", why });
    return why;
  }

  /** A table without names: from index 0 until the robot says that there is no more. */
  private async discover(source: Source): Promise<void> {
    const field = source.set.fields.find((one) => one.name === "value");
    if (!field) return;
    const found: Parameter[] = [];
    for (let index = 0; index < MOST_INDICES; index++) {
      const parameter = { key: String(index), label: String(index), field, selector: { index } };
      if ((await this.readOne(parameter)) !== null) break;
      found.push(parameter);
      this.found = [...found];
    }
  }

  private takeOne(parameter: Parameter, reply: Reply, why: string | null): void {
    if (typeof reply.fields.value === "number") this.takeValue(parameter, reply.fields.value, why);
  }

  private takeFields(fields: Record<string, unknown>, why: string | null = null): void {
    for (const parameter of this.source?.parameters ?? []) {
      const value = fields[parameter.field.name];
      if (typeof value === "number") this.takeValue(parameter, value, why);
    }
  }

  private takeValue(parameter: Parameter, inForce: number, why: string | null): void {
    const one = this.of(parameter);
    const isFirst = one.state === "unknown" || one.state === "same";
    const wanted = isFirst ? Number(inForce.toPrecision(7)) : one.wanted;
    const same = isSame(wanted, inForce, parameter.field.step);
    const state = why !== null ? "refused" : same ? "same" : one.state === "changed" ? "changed" : "different";
    this.put(parameter, { wanted, inForce, state, why: why ?? "" });
  }

  /** Fields of the message that neither select nor are values: their defaults. */
  private rest(): Record<string, unknown> {
    const source = this.source!;
    return Object.fromEntries(
      source.set.fields
        .filter((field) => field.default !== null && !field.is_count)
        .map((field) => [field.name, field.default]),
    );
  }

  /** True: it was done. */
  private async busy(doing: () => Promise<void>): Promise<boolean> {
    this.isBusy = true;
    this.problem = "";
    try {
      await doing();
    } catch (error) {
      this.problem = error instanceof Refusal || error instanceof Error ? error.message : String(error);
    }
    this.isBusy = false;
    return this.problem === "";
  }

  /** A robot that does not answer now may answer later; one that never does is asked seldom. */
  private waitAfterFailure(): void {
    this.endWait();
    this.isWaiting = true;
    this.waiting = setTimeout(() => this.endWait(), Math.min(RETRY_LAST, RETRY_FIRST * 2 ** this.failures++));
  }
  private endWait(): void {
    clearTimeout(this.waiting);
    this.isWaiting = false;
  }

  private put(parameter: Parameter, one: One): void {
    this.all[this.place(parameter.key)] = one;
  }
  private place = (key: string) => `${Object.values(this.selected).join(" ")} ${key}`;
  private key = () => `wirebond.sets.${this.protocol}.${this.source?.name ?? ""}`;
}
