// A frame's bytes beside their meaning: which byte belongs to which part, and the texts to copy.
export interface Part {
  name: string;
  level: number;
  offset: number;
  wire: string;
  data: string;
  meaning: string;
  state: "good" | "wrong" | "named";
}
export interface Stretch {
  kind: "frame" | "refused" | "noise" | "fill";
  offset: number;
  wire: string;
  cause: string;
  summary: string;
  rows: Part[];
  rules: { rule: string; expected: string; found: string; holds: boolean }[];
  guesses: { what: string; remedy: string; reading: string }[];
}
export interface Explanation {
  stretches: Stretch[];
}
export interface Byte {
  hex: string;
  part: number; // index in `parts`; -1: no part names it
}

/** All parts of an explanation in order, and for each byte the deepest part that names it. */
export function bytesOf(explanation: Explanation): { bytes: Byte[]; parts: Part[] } {
  const bytes: Byte[] = [];
  const parts: Part[] = [];
  for (const stretch of explanation.stretches) {
    const hexes = stretch.wire.match(/../g) ?? [];
    hexes.forEach((hex, index) => {
      bytes[stretch.offset + index] = { hex: hex.toUpperCase(), part: -1 };
    });
    for (const row of stretch.rows) {
      const index = parts.push(row) - 1;
      const size = row.wire.length / 2;
      for (let place = row.offset; place < row.offset + size; place++) {
        const byte = bytes[place];
        if (byte && (byte.part < 0 || (parts[byte.part]?.level ?? 0) <= row.level)) byte.part = index;
      }
    }
  }
  return { bytes, parts };
}

/** A call of the Python API that makes this message. */
export function asPython(message: string, fields: Record<string, unknown>): string {
  const values = Object.entries(fields).map(([name, value]) => {
    const isWord = /^[A-Za-z_]\w*$/.test(name);
    return isWord ? `${name}=${pythonValue(value)}` : `**{${pythonValue(name)}: ${pythonValue(value)}}`;
  });
  return `link.send(${[pythonValue(message), ...values].join(", ")})`;
}

export function pythonValue(value: unknown): string {
  if (value === null || value === undefined) return "None";
  if (value === true) return "True";
  if (value === false) return "False";
  if (typeof value === "number") return String(value);
  if (typeof value === "string") return JSON.stringify(value);
  if (Array.isArray(value)) return `[${value.map(pythonValue).join(", ")}]`;
  const inner = Object.entries(value as object).map(([name, one]) => `${JSON.stringify(name)}: ${pythonValue(one)}`);
  return `{${inner.join(", ")}}`;
}
