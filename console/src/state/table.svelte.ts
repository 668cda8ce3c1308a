// The table of messages: a line for each message of the protocol, with its newest values. It stops while all is paused.
import { untrack } from "svelte";
import type { Message } from "../protocol";
import { live } from "./live.svelte";
import { time } from "./time.svelte";
import type { Row } from "../views";

export interface Line {
  key: string;
  message: Message;
  sender: "host" | "mcu";
  row: Row | null;
}
const EVERY = 0.1; // seconds between two batches of rows

export class Table {
  private frozen = $state.raw<Row[] | null>(null);
  // Messages that never came have a line, too: that they are missing is worth seeing.
  readonly lines = $derived.by(() => {
    const rows = new Map((this.frozen ?? live.rows).map((row) => [`${row.sender}:${row.name}`, row]));
    const all: Line[] = [];
    for (const message of live.shown?.messages ?? [])
      for (const sender of message.sender === "both" ? (["mcu", "host"] as const) : [message.sender]) {
        const key = `${sender}:${message.name}`;
        all.push({ key, message, sender, row: rows.get(key) ?? null });
      }
    return all.sort((a, b) => Number(a.sender === "host") - Number(b.sender === "host"));
  });

  /** Asks for rows while the view that calls it is there. */
  constructor() {
    $effect(() => live.show("messages", { every: EVERY }));
    $effect(() => {
      this.frozen = time.pausedAt === null ? null : untrack(() => live.rows);
    });
  }
}
