// A message that is a log line as its text, with the values in their places.
import type { Facts } from "./facts";

type Line = Facts["log"][string];
const LEVELS = ["debug", "info", "warning", "error"]; // by the number that the log service has on the wire

export function logText(line: Line, fields: Record<string, unknown>): { level: string; text: string } {
  if (line.pieces === null) {
    const level = fields.level;
    const named = typeof level === "number" ? (LEVELS[level] ?? `level ${level}`) : String(level);
    return { level: named, text: String(fields.text ?? "") };
  }
  const text = line.pieces
    .map((piece) => (typeof piece === "string" ? piece : shown(fields[piece.field], piece.decimals)))
    .join("");
  return { level: line.level, text };
}

/** `decimals`: as many as the wire carries; null: six digits. */
function shown(value: unknown, decimals: number | null): string {
  if (value === undefined) return "?";
  if (Array.isArray(value)) return value.map((one) => shown(one, decimals)).join(", ") || "none";
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (typeof value === "number" && (decimals !== null || !Number.isInteger(value))) {
    return decimals === null ? String(Number(value.toPrecision(6))) : value.toFixed(decimals);
  }
  if (value instanceof Uint8Array) {
    return [...value].map((byte) => byte.toString(16).padStart(2, "0").toUpperCase()).join(" ");
  }
  if (value !== null && typeof value === "object") {
    return Object.entries(value)
      .map(([name, one]) => `${name} ${shown(one, decimals)}`)
      .join(", ");
  }
  return String(value);
}
