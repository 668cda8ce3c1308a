// Chinese for the English sentences of a page without a server. The tables, and how a sentence is found in them, are those
// of wirebond/chinese.py: a pair is two lines; `{name}` is taken over, `{~name}` is translated itself if it has a pair, and
// `{#name}` is a whole number. A sentence without a pair stays English.
const LONGEST = 2000; // characters of a sentence
const DEEPEST = 12; // sentences within one another
const KEPT = 512; // answers: a page shows the same sentences again with each picture
const PLACE = /\{([~#]?\w+)\}/;

interface Pair {
  literals: string[]; // one more than names
  names: string[];
  chinese: string;
}

export class Chinese {
  private readonly whole = new Map<string, string>();
  private readonly open: Pair[] = []; // those with the most words of their own first
  private readonly kept = new Map<string, string | null>(); // the newest answers, the oldest first

  constructor(tables: string) {
    for (const block of tables.trim().split(/\n\s*\n/)) {
      const [english, chinese] = block.split("\n").filter((line) => !line.startsWith("#"));
      if (english === undefined || chinese === undefined) continue;
      const cut = english.split(PLACE);
      const literals = cut.filter((_, i) => i % 2 === 0);
      if (literals.length === 1) this.whole.set(english, chinese);
      else this.open.push({ literals, names: cut.filter((_, i) => i % 2 === 1), chinese });
    }
    const words = (pair: Pair) => pair.literals.join("").length;
    this.open.sort((a, b) => words(b) - words(a));
  }

  /** Returns the sentence in Chinese, or null if it has no pair. */
  find(text: string): string | null {
    if (text.length > LONGEST) return null;
    const kept = this.kept.get(text);
    if (kept !== undefined) return kept;
    const found = this.search(text, 0);
    if (this.kept.size >= KEPT) this.kept.delete(this.kept.keys().next().value!);
    this.kept.set(text, found);
    return found;
  }

  private search(text: string, depth: number): string | null {
    if (text.length > LONGEST || depth > DEEPEST) return null;
    const known = this.whole.get(text);
    if (known !== undefined) return known;
    for (const begin of [text.slice(0, 1), ""]) {
      for (const pair of this.open) {
        if (pair.literals[0]!.slice(0, 1) !== begin) continue;
        const values = valuesOf(pair, text);
        if (values) return this.filled(pair, values, depth);
      }
    }
    return null;
  }

  private filled(pair: Pair, values: Map<string, string>, depth: number): string {
    return pair.chinese.replace(new RegExp(PLACE, "g"), (_, name: string) => {
      const value = values.get(name)!;
      return (name.startsWith("~") ? this.search(value, depth + 1) : null) ?? value;
    });
  }
}

/** The texts at the places of a pair; null: it is another sentence. */
function valuesOf({ literals, names }: Pair, text: string): Map<string, string> | null {
  const [first, last] = [literals[0]!, literals.at(-1)!];
  if (!text.startsWith(first) || !text.endsWith(last) || text.length < first.length + last.length) return null;
  const end = text.length - last.length;
  const found = new Map<string, string>();
  let at = first.length;
  for (const [i, name] of names.slice(0, -1).entries()) {
    const behind = literals[i + 1]!;
    const stop = text.indexOf(behind, at);
    if (stop < 0 || stop + behind.length > end) return null;
    found.set(name, text.slice(at, stop));
    at = stop + behind.length;
  }
  found.set(names.at(-1)!, text.slice(at, end));
  for (const [name, value] of found) if (name.startsWith("#") && !/^\d+$/.test(value)) return null;
  return found;
}
