// Decodes a stream in the engine's WebAssembly module, read by read, and reads every value of every frame in JavaScript.
// Usage: node page_decode.mjs MODULE TABLES STREAM SECONDS; prints frames, their sum of values, and the seconds it took.
import { readFileSync } from "node:fs";
import { decode } from "../console/node_modules/@msgpack/msgpack/dist.esm/index.mjs";

const EITHER = 2; // whose frames: of both ends
const READ = 16384; // bytes, as a serial port gives them to a page at most
const [modulePath, tablesPath, streamPath, seconds] = process.argv.slice(2);

const module = await WebAssembly.compile(readFileSync(modulePath));
const imports = {};
for (const { module: from, name } of WebAssembly.Module.imports(module)) (imports[from] ??= {})[name] = () => 0;
const { exports } = await WebAssembly.instantiate(module, imports);
exports._initialize();

function given(bytes) {
  const at = exports.input(bytes.length); // first: the memory may grow, and its old buffer is gone then
  new Uint8Array(exports.memory.buffer).set(bytes, at);
}

function result(at) {
  const answer = decode(new Uint8Array(exports.memory.buffer, at, exports.result_size()));
  if ("error" in answer) throw new Error(answer.text);
  return answer.ok;
}

/** Every value of every frame, added up. */
function decodeAll(stream) {
  let frames = 0;
  let sum = 0;
  for (let begin = 0; begin < stream.length; begin += READ) {
    const read = stream.subarray(begin, begin + READ);
    const input = new Uint8Array(16 + read.length); // when it began, where it ends, its bytes
    new Float64Array(input.buffer, 0, 2).set([begin, read.length]);
    input.set(read, 16);
    given(input);
    const at = exports.follow(EITHER, 1);
    const memory = exports.memory.buffer;
    const words = new Uint32Array(memory, at, exports.result_size() / 4);
    for (let i = 0; i < words.length; ) {
      const columns = ofMessages[words[i]] ?? []; // unknown frames have none
      const rows = words[i + 1];
      frames += rows;
      i += 5;
      for (const [, count] of columns) {
        const values = new Float64Array(memory, words[i++], rows * count);
        for (let k = 0; k < values.length; k++) sum += values[k];
      }
    }
  }
  return { frames, sum };
}

given(readFileSync(tablesPath));
result(exports.open());
const ofMessages = result(exports.columns());
const stream = readFileSync(streamPath);
const once = decodeAll(stream);
let frames = 0;
const begin = performance.now();
while (performance.now() - begin < 1000 * Number(seconds)) frames += decodeAll(stream).frames;
console.log(JSON.stringify({ ...once, perSecond: (1000 * frames) / (performance.now() - begin) }));
