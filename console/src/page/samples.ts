// Samples of fields as CSV: every one of a range, with units and the times of its message.
import type { Field, Protocol } from "../protocol";
import type { Source } from "./source";
import type { Track } from "./history";

const ROWS = 1 << 14; // in one part of the file

/** A row for each message that came from `begin` to `end`, both included. `zero`: seconds since 1970 at the time 0 of the
 *  source. Throws an `Error` if a field cannot be plotted. */
export function samplesAsCsv(source: Source, fields: string[], begin: number, end: number, zero: number): Blob {
  const wanted = [...new Set(fields)];
  if (wanted.length === 0) throw new Error("no field is chosen; choose one to plot first");
  const found = wanted.map((name, place) => ({ name, place, ...source.history.find(name) }));
  const parts: { t: number; track: Track; cells: () => string[] }[] = [];
  for (const track of new Set(found.map((one) => one.track))) {
    const mine = found
      .filter((one) => one.track === track)
      .map(({ place, column }) => ({ place, c: track.columns.indexOf(column) }));
    track.each(begin, end, (chunk, from, to) => {
      for (let i = from; i < to; i++) {
        const cells = () => {
          const out = new Array<string>(wanted.length).fill("");
          for (const { place, c } of mine) out[place] = String(chunk.columns[c]![i]);
          return out;
        };
        parts.push({ t: chunk.t[i]!, track, cells });
      }
    });
  }
  parts.sort((a, b) => a.t - b.t);
  const head = ["time", "t [s]", "message", ...found.map(({ name }) => withUnit(source.facts.protocol, name))];
  const out: string[] = [];
  let lines = [head.map(quoted).join()];
  for (const { t, track, cells } of parts) {
    const time = new Date(1000 * (t + zero)).toISOString();
    lines.push([time, (t + zero).toFixed(6), quoted(track.name), ...cells()].join());
    if (lines.length < ROWS) continue;
    out.push(`${lines.join("\n")}\n`);
    lines = [];
  }
  out.push(lines.length > 0 ? `${lines.join("\n")}\n` : "");
  return new Blob(out, { type: "text/csv;charset=utf-8" });
}

const quoted = (text: string) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);

function withUnit(protocol: Protocol, name: string): string {
  const [message, ...path] = name
    .replace(/^(host|mcu):/, "")
    .replace(/\[\d+\]/g, "")
    .split(".");
  let fields: Field[] | null = protocol.messages.find((one) => one.name === message)?.fields ?? null;
  let field: Field | undefined;
  for (const step of path) {
    field = fields?.find((one) => one.name === step);
    fields = field?.fields ?? null;
  }
  return field?.unit ? `${name} [${field.unit}]` : name;
}
