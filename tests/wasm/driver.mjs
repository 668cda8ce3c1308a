// Calls the module's functions for another process: a request is the size of a JSON head and of the input (u32 each), the
// head, the input; the answer is the size of a JSON head and of the result's bytes, the head, the bytes.
import { readFileSync, readSync, writeSync } from "node:fs";

const module = await WebAssembly.compile(readFileSync(process.argv[2]));
const imports = {};
for (const { module: from, name } of WebAssembly.Module.imports(module)) {
  (imports[from] ??= {})[name] = () => {
    throw new Error(`the engine called ${name}`);
  };
}
const { exports } = await WebAssembly.instantiate(module, imports);
exports._initialize();

function read(size) {
  const bytes = Buffer.alloc(size);
  for (let done = 0; done < size; ) {
    const got = readSync(0, bytes, done, size - done);
    if (got === 0) process.exit(0);
    done += got;
  }
  return bytes;
}

function write(bytes) {
  for (let done = 0; done < bytes.length; ) done += writeSync(1, bytes, done);
}

/** Numbers at an address, for rows of a follower. */
function numbers([address, count]) {
  return Buffer.from(new Uint8Array(exports.memory.buffer, address, 8 * count));
}

for (;;) {
  const sizes = read(8);
  const { name, args } = JSON.parse(read(sizes.readUInt32LE(0)).toString());
  const input = read(sizes.readUInt32LE(4));
  let answer = null;
  let bytes = Buffer.alloc(0);
  if (name === "numbers") {
    bytes = numbers(args);
  } else if (name === "memory") {
    answer = exports.memory.buffer.byteLength;
  } else {
    const at = exports.input(input.length);
    new Uint8Array(exports.memory.buffer).set(input, at);
    answer = exports[name](...args) ?? null;
    const size = exports.result_size();
    const isAddress = answer > 0 && answer + size <= exports.memory.buffer.byteLength; // or any number
    bytes = Buffer.from(new Uint8Array(exports.memory.buffer, isAddress ? answer : 0, isAddress ? size : 0));
    if (answer === Infinity) answer = "Infinity";
  }
  const head = Buffer.from(JSON.stringify(answer));
  const lengths = Buffer.alloc(8);
  lengths.writeUInt32LE(head.length, 0);
  lengths.writeUInt32LE(bytes.length, 4);
  write(Buffer.concat([lengths, head, bytes]));
}
