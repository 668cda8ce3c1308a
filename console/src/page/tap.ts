// New entries of the link's tap: reads and writes with their times, and events.
import type { Engine } from "./engine";
import type { Facts } from "./facts";

export interface Event {
  t: number;
  kind: string;
  facts: Record<string, unknown>;
}
/** What a tap has brought, in its order. */
export interface Taken {
  received: { t: number; done: number; bytes: Uint8Array }[];
  sent: { t: number; done: number; bytes: Uint8Array }[];
  events: Event[];
  /** Before which read of each direction the port was closed. */
  breaks: { t: number; received: number; sent: number }[];
  lost: number;
}
const KINDS = [
  "received",
  "sent",
  "port_up",
  "port_down",
  "stopped",
  "released",
  "deadline_struck",
  "deadline_ended",
  "lease_begun",
  "lease_ended",
  "noted",
  "port_settings",
]; // in the order of TapKind

export function takeTap(engine: Engine, facts: Facts): Taken {
  const [pieces, lost] = engine.call<[[number, number, number, Uint8Array][], number]>("tap_take");
  const taken: Taken = { received: [], sent: [], events: [], breaks: [], lost };
  for (const [number, before, done, data] of pieces) {
    const kind = KINDS[number]!;
    const t = done * 1e-6;
    if (kind === "received" || kind === "sent") {
      taken[kind].push({ t: before * 1e-6, done: t, bytes: data });
      continue;
    }
    if (kind === "port_down") taken.breaks.push({ t, received: taken.received.length, sent: taken.sent.length });
    taken.events.push({ t, ...eventOf(kind, data, facts) });
  }
  return taken;
}

function eventOf(kind: string, data: Uint8Array, facts: Facts): { kind: string; facts: Record<string, unknown> } {
  const text = () => new TextDecoder().decode(data);
  if (kind === "noted") {
    const { kind: noted, ...of } = JSON.parse(text()) as { kind: string };
    return { kind: noted, facts: of };
  }
  if (kind === "port_down") return { kind, facts: { why: text() || "the link was closed" } };
  if (kind.startsWith("deadline")) return { kind, facts: { action: facts.actions[data[0]!] } };
  if (kind.startsWith("lease")) {
    const [message, address, why] = text().split(" ");
    const of = { message: facts.protocol.messages[Number(message)]?.name, address: Number(address) };
    return { kind, facts: why === undefined ? of : { ...of, why } };
  }
  return { kind, facts: {} };
}
