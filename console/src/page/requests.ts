// Which request a reply answers: by its message, its address, the fields that it carries back, and the order.
import type { Message } from "./engine";
import type { Facts } from "./facts";

const OWN_SEND = 1; // seconds that the reply to a message of plain `send` may take
const LATE = 10; // seconds after which no reply to an old request is expected any more
const MOST = 1024; // questions of one reply that are remembered
const SLACK = 0.05; // seconds: a message that was read longer than this before its request left is not a reply to it

type Outcome = { reply: Message } | { error: Error };

/** One frame that asks for a reply. `finish` is called once; null: no caller waits. */
export interface Question {
  message: string;
  reply: string;
  values: Record<string, unknown>; // as they are on the wire
  address: number | null; // whom it asks; null: anybody
  finish: ((outcome: Outcome) => void) | null;
  leave(): void; // sends it; throws if it is refused
  since: number; // seconds; 0: it has not left
  until: number;
  isOver: boolean; // it was given up: it may only take a reply that is certainly its own
}

export class RequestBook {
  private readonly asked = new Map<string, Question[]>(); // by reply, in the order of the line
  private readonly waiting: Question[] = [];

  /** `addressOf`: of who sent a message; null: frames do not say. */
  constructor(
    private readonly facts: Facts,
    private readonly now: () => number,
    private readonly addressOf: (message: Message) => number | null,
  ) {}

  question(
    message: string,
    values: Record<string, unknown>,
    address: number | null,
    leave: () => void,
    finish: Question["finish"],
  ): Question {
    const isAnyone = address === null || this.facts.address.broadcasts.includes(address);
    const reply = this.facts.requests[message]!.reply;
    return {
      message,
      reply,
      values,
      address: isAnyone ? null : address,
      finish,
      leave,
      since: 0,
      until: 0,
      isOver: false,
    };
  }

  /** Sends it, now or when its turn comes. Throws if it is refused at once. */
  submit(question: Question): void {
    // Where only the request identifies a reply, the next request waits for the end of the one before.
    if (this.facts.told && question.finish && this.isBusy()) this.waiting.push(question);
    else this.leave(question);
  }

  /** Ends the request without a reply. The next one leaves. */
  withdraw(question: Question): void {
    question.finish = null;
    question.isOver = true;
    question.until = this.now() + LATE;
    drop(this.waiting, question);
    if (this.facts.requests[question.message]!.carried.length === 0) drop(this.asked.get(question.reply), question);
    this.next();
  }

  /** Gives a received message to the request that it answers. */
  take(message: Message): void {
    const asked = this.asked.get(message.name);
    if (!asked || asked.length === 0) return;
    const question = this.answeredBy(message, asked);
    if (!question) return;
    drop(asked, question);
    const { finish } = question;
    question.finish = null;
    if (!question.isOver) finish?.({ reply: message });
    this.next();
  }

  /** No reply will come any more. */
  end(error: Error): void {
    const all = [...this.waiting, ...[...this.asked.values()].flat()];
    this.waiting.length = 0;
    this.asked.clear();
    for (const { finish } of all) finish?.({ error });
  }

  private answeredBy(message: Message, asked: Question[]): Question | undefined {
    const now = this.now();
    for (const old of asked.filter((one) => !one.finish && one.until < now)) drop(asked, old);
    const sender = this.addressOf(message);
    const fitting = asked.filter(
      (one) => (one.address === null || sender === null || one.address === sender) && message.t >= one.since - SLACK,
    );
    const carriesAll = (one: Question) => {
      const { carried } = this.facts.requests[one.message]!;
      return carried.length > 0 && carried.every((name) => carries(message, one, name));
    };
    const same = fitting.filter(carriesAll); // it says whose it is; of several the first that still waits
    if (same.length > 0) return same.find((one) => !one.isOver) ?? same[0];
    return fitting.find((one) => {
      const { identifying } = this.facts.requests[one.message]!;
      return !one.isOver && (identifying.length === 0 || identifying.some((name) => carries(message, one, name)));
    });
  }

  private isBusy(): boolean {
    return this.waiting.length > 0 || [...this.asked.values()].some((asked) => asked.some((one) => one.finish));
  }

  private leave(question: Question): void {
    const asked = this.asked.get(question.reply) ?? [];
    this.asked.set(question.reply, asked);
    if (asked.length >= MOST) drop(asked, asked.find((one) => !one.finish) ?? asked[0]!);
    question.since = this.now();
    question.until = question.since + OWN_SEND;
    asked.push(question);
    try {
      question.leave();
    } catch (error) {
      drop(asked, question);
      throw error;
    }
  }

  private next(): void {
    while (this.waiting.length > 0 && ![...this.asked.values()].some((asked) => asked.some((one) => one.finish))) {
      const question = this.waiting.shift()!;
      try {
        this.leave(question);
      } catch (error) {
        question.finish?.({ error: error as Error });
        question.finish = null;
      }
    }
  }
}

function drop<T>(from: T[] | undefined, what: T): void {
  const place = from?.indexOf(what) ?? -1;
  if (place >= 0) from!.splice(place, 1);
}

const text = (value: unknown) =>
  JSON.stringify(value, (_, one: unknown) => (typeof one === "bigint" ? `${one}n` : one));
const carries = (message: Message, one: Question, name: string) =>
  name in one.values && text(message.fields[name]) === text(one.values[name]);
