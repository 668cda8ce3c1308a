// The link at a moment of a recording, computed from the rows of messages, events and marks of that time.
import type { Protocol } from "./protocol";
import type { LinkEvent, Row } from "./views";

export interface Moment {
  /** The newest loss of the port that had not ended; null: the port was there. */
  away: LinkEvent | null;
  isStopped: boolean;
  /** Deadlines that had struck, and still held. */
  struck: LinkEvent[];
  discarded: { received: number; sent: number }; // bytes
}

/** @param marks of the whole recording, by time
 *  @param rows as they were at that time */
export function momentOf(marks: readonly LinkEvent[], rows: readonly Row[], protocol: Protocol, at: number): Moment {
  const moment: Moment = { away: null, isStopped: false, struck: [], discarded: { received: 0, sent: 0 } };
  const ended = (action: unknown) => (moment.struck = moment.struck.filter((one) => one.action !== action));
  for (const mark of marks) {
    if (mark.t > at) break;
    if (mark.kind === "port_down") moment.away = mark;
    else if (mark.kind === "port_up") moment.away = null;
    else if (mark.kind === "stopped") moment.isStopped = true;
    else if (mark.kind === "released") moment.isStopped = false;
    else if (mark.kind === "discarded") moment.discarded[mark.direction as "received" | "sent"] += Number(mark.bytes);
    else if (mark.kind === "deadline_ended") ended(mark.action);
    else if (mark.kind === "deadline_struck") moment.struck.push(mark);
    else if (mark.kind === "mcu_deadline_struck" && !isOver(mark, rows, protocol)) moment.struck.push(mark);
  }
  return moment;
}

/** The message came again, or the deadline was ended otherwise. */
function isOver(mark: LinkEvent, rows: readonly Row[], protocol: Protocol): boolean {
  const rule = protocol.deadlines.find(
    (one) => one.at === "mcu" && one.then === mark.action && one.message === mark.message,
  );
  const ender = rule?.recover === "explicit" ? rule.recover_by?.message : mark.message;
  const row = rows.find((one) => one.name === ender && one.sender === "host");
  return row?.t != null && row.t > mark.t;
}
