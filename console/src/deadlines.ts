// What the robot's deadlines do to a message that is sent: hold it back, or have stopped the robot. The server works it
// out from what was sent, for most robots do not say. It sends nothing.
import { valueText, type Field, type Message, type Protocol } from "./protocol";
import type { LinkView, Row } from "./views";

type Deadline = Protocol["deadlines"][number];
export interface Hold {
  /** `held`: the robot ignores the message until it recovers. `silent`: it has stopped, and the next message ends that.
   * `unsure`: events before this link was opened decide. */
  kind: "held" | "silent" | "unsure";
  deadline: Deadline;
  since: number | null; // the server's time
}

/** The worst that holds for this message; null: nothing does. */
export function holdOf(protocol: Protocol | null, link: LinkView | null, message: string): Hold | null {
  if (!protocol || !link || link.state === "down" || link.port?.startsWith("replay:")) return null;
  const found: Hold[] = [];
  for (const state of link.mcu_deadlines ?? []) {
    const deadline = protocol.deadlines[state.deadline];
    if (!deadline || deadline.message !== message) continue;
    const isExplicit = deadline.recover === "explicit";
    if (state.since !== null) found.push({ kind: isExplicit ? "held" : "silent", deadline, since: state.since });
    else if (state.unknown && isExplicit) found.push({ kind: "unsure", deadline, since: null });
  }
  const rank = { held: 0, silent: 1, unsure: 2 };
  return found.sort((a, b) => rank[a.kind] - rank[b.kind] || b.deadline.after - a.deadline.after)[0] ?? null;
}

export interface Saying {
  message: string;
  t: number | null; // null: it never came
  words: string[]; // `errors: comm_timeout`
  ask: Message | null; // the host may send it to get the value
}

/** What the robot says of its own state: the flags and enums of messages that come regularly or can be asked for. */
export function sayingsOf(protocol: Protocol, rows: readonly Row[]): Saying[] {
  const services = new Set(protocol.services.flatMap((service) => Object.values(service.messages)));
  const found: Saying[] = [];
  for (const message of protocol.messages) {
    const words = message.fields.filter((field) => field.kind === "flags" || field.kind === "enum");
    if (message.sender === "host" || services.has(message.name) || !words.length) continue;
    const asks = protocol.messages.filter((one) => one.reply === message.name && !one.is_controlled);
    const ask = asks.find((one) => one.fields.every((field) => field.default !== null || field.is_count)) ?? null;
    if (message.every === null && !ask) continue;
    const row = rows.find((one) => one.name === message.name && one.sender === "mcu");
    const said = row?.fields ? words.map((field) => wordsOf(field, row.fields![field.name])) : [];
    found.push({ message: message.name, t: row?.t ?? null, words: said, ask });
  }
  return found;
}

function wordsOf(field: Field, value: unknown): string {
  return `${field.name}: ${Array.isArray(value) && !value.length ? "–" : valueText(value, field)}`;
}
