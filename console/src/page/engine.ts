// The engine's WebAssembly module (engine/wasm): one protocol, its decoders, and the host's link. No rule is here.
import { decode, encode } from "@msgpack/msgpack";

const WHOLE = { useBigInt64: true }; // numbers of 64 bits keep all their bits

/** Whose frames, as the module numbers them. */
export const MCU = 0;
export const HOST = 1;
export type Sender = typeof MCU | typeof HOST;
export const SENDERS = [MCU, HOST] as const;
export const senderName = (sender: Sender): "mcu" | "host" => (sender === MCU ? "mcu" : "host");

/** A value was refused, with a sentence; or the module found a mistake of the page's own. */
export class EngineError extends Error {
  constructor(
    readonly kind: "message" | "engine",
    text: string,
  ) {
    super(text);
  }
}
/** A message as the module gives it. */
export interface Message {
  t: number;
  offset: number;
  id: number;
  raw: Uint8Array;
  header: Record<string, unknown>;
  name: string;
  sender?: string;
  fields: Record<string, unknown>;
  violations: string[];
}
/** Rows of one message. The arrays are in the module's memory and valid until the next call. */
export interface Rows {
  message: number; // its index; the number of messages: frames of unknown ones
  t: Float64Array;
  offset: BigUint64Array;
  size: Uint32Array;
  columns: Float64Array[];
}
interface Exports {
  memory: WebAssembly.Memory;
  [name: string]: unknown;
}
type Call = (...args: number[]) => number;
const NONE = new Uint8Array(0);

/** Numbers of 64 bits as plain ones where those hold them. */
function narrowed(value: unknown): unknown {
  if (typeof value === "bigint") return Number.isSafeInteger(Number(value)) ? Number(value) : value;
  if (Array.isArray(value)) return value.map(narrowed);
  if (value === null || typeof value !== "object" || value instanceof Uint8Array) return value;
  for (const [name, one] of Object.entries(value)) (value as Record<string, unknown>)[name] = narrowed(one);
  return value;
}

export class Engine {
  /** Of each message, its columns: the name, and how many numbers each row has. */
  columns: [string, number][][] = [];

  private constructor(private readonly exports: Exports) {}

  static async load(bytes: BufferSource): Promise<Engine> {
    const module = await WebAssembly.compile(bytes);
    const imports: Record<string, Record<string, () => never>> = {};
    for (const { module: from, name } of WebAssembly.Module.imports(module)) {
      (imports[from] ??= {})[name] = () => {
        throw new EngineError("engine", `the engine called ${name}, which a page does not have`);
      };
    }
    const { exports } = await WebAssembly.instantiate(module, imports);
    const engine = new Engine(exports as unknown as Exports);
    (engine.exports._initialize as () => void)();
    return engine;
  }

  /** Opens a protocol: `tables` as `session_table` of Python packs them. Ends the one that was open. */
  open(tables: Uint8Array): void {
    this.call("open", tables);
    this.columns = this.call("columns");
  }

  /** Calls a function that answers with a value. Throws an `EngineError`. */
  call<T>(name: string, input: Uint8Array = NONE, ...args: number[]): T {
    this.give(input);
    const bytes = this.view(this.function(name)(...args)).slice(); // bytes in the value refer to these
    const answer = decode(bytes, WHOLE) as { ok: T } | { error: string; text: string };
    if ("error" in answer) throw new EngineError(answer.error === "message" ? "message" : "engine", answer.text);
    return narrowed(answer.ok) as T;
  }

  /** The same, where the input is a value. */
  ask<T>(name: string, input: unknown, ...args: number[]): T {
    return this.call<T>(name, encode(input, WHOLE), ...args);
  }

  /** Calls a function that returns a number or nothing. */
  do(name: string, ...args: number[]): number {
    return this.function(name)(...args);
  }

  doWith(name: string, input: Uint8Array, ...args: number[]): number {
    this.give(input);
    return this.function(name)(...args);
  }

  /** Calls a function whose result is bytes; returns a copy. */
  bytes(name: string, ...args: number[]): Uint8Array<ArrayBuffer> {
    return this.view(this.function(name)(...args)).slice();
  }

  /** Calls a function whose result is rows. */
  rows(name: string, input: Uint8Array, ...args: number[]): Rows[] {
    this.give(input);
    const at = this.function(name)(...args);
    const memory = this.exports.memory.buffer;
    const words = new Uint32Array(memory, at, this.size() / 4);
    const found: Rows[] = [];
    for (let i = 0; i < words.length;) {
      const message = words[i]!;
      const count = words[i + 1]!;
      const rows: Rows = {
        message,
        t: new Float64Array(memory, words[i + 2], count),
        offset: new BigUint64Array(memory, words[i + 3], count),
        size: new Uint32Array(memory, words[i + 4], count),
        columns: [],
      };
      i += 5;
      for (const [, each] of this.columns[message] ?? []) {
        rows.columns.push(new Float64Array(memory, words[i++], count * each));
      }
      found.push(rows);
    }
    return found;
  }

  private give(input: Uint8Array): void {
    const at = this.function("input")(input.length); // first: the memory may grow, and its old buffer is gone then
    new Uint8Array(this.exports.memory.buffer).set(input, at);
  }

  private view(at: number): Uint8Array<ArrayBuffer> {
    return new Uint8Array(this.exports.memory.buffer as ArrayBuffer, at, this.size());
  }

  private size(): number {
    return this.function("result_size")();
  }

  private function(name: string): Call {
    return this.exports[name] as Call;
  }
}
