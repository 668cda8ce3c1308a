// The protocol file that is edited: the one in force, or a first one of a device that no file describes. It stays while
// the reader looks at other views. What is not in force yet is kept in this browser, of each file, and offered again.
import type { Protocol } from "../protocol";
import { place } from "./place.svelte";

/** Text that was edited, and never came into force. */
export interface Kept {
  key: string;
  name: string;
  base: string;
  text: string;
  notes: string[];
  at: number; // milliseconds since 1970
}
const KEYS = "wirebond.draft.";
const NEW = `${KEYS}new:`; // of the first file of a device

class Draft {
  name = $state("");
  base = $state(""); // the text that was begun with
  text = $state("");
  notes = $state.raw<string[]>([]); // parts of an imported file that could not be converted
  isNew = $state(false); // no file of this text is in force
  /** Where the server wrote it last, and the text. */
  saved = $state.raw<{ path: string; text: string } | null>(null);
  /** What an earlier visit left. Until the reader restores or discards it, nothing takes its place. */
  kept = $state.raw<Kept | null>(read(NEW));
  private key = ""; // where this text is kept
  private hash = "";
  readonly isChanged = $derived(this.text !== this.base);
  /** Is there text that the reader typed and that is in no file? */
  readonly isUnsaved = $derived(this.isChanged && this.saved?.text !== this.text);

  constructor() {
    $effect.root(() => {
      $effect(() => this.keep());
    });
    addEventListener("beforeunload", (event) => {
      if (this.isUnsaved) event.preventDefault();
    });
  }

  /** Edits the protocol in force, unless its text is being edited already. */
  follow(protocol: Protocol): void {
    if (this.hash === protocol.hash) return;
    this.keep();
    if (this.isNew && this.text === protocol.text) remove(NEW);
    this.begin(protocol.name, protocol.text, [], protocol.hash);
    this.isNew = false;
    this.key = `${KEYS}${protocol.path || protocol.name}`;
    this.kept = this.left();
  }

  /** Edits a first file, in the view of the protocol. */
  start(name: string, text: string, notes: string[] = []): void {
    this.begin(name, text, notes, "");
    this.isNew = true;
    this.key = NEW;
    if (this.kept?.key === NEW) this.kept = null; // the reader began another one
    place.open("protocol");
  }

  drop(): void {
    this.begin("", "", [], "");
    this.isNew = false;
    this.key = "";
    remove(NEW);
  }

  restore(): void {
    const kept = this.kept;
    if (!kept) return;
    this.kept = null;
    this.key = kept.key;
    this.isNew = kept.key === NEW;
    this.name = kept.name;
    this.notes = kept.notes;
    if (this.isNew) this.base = kept.base;
    this.text = kept.text;
  }

  discard(): void {
    if (!this.kept) return;
    remove(this.kept.key);
    this.kept = this.left();
  }

  private begin(name: string, text: string, notes: string[], hash: string): void {
    this.name = name;
    this.base = this.text = text;
    this.notes = notes;
    this.hash = hash;
    if (this.saved?.text !== text) this.saved = null;
  }

  /** What is there to be offered: of this file, else a first file. */
  private left(): Kept | null {
    const own = this.key ? read(this.key) : null;
    if (own && own.text !== this.base) return own;
    if (own) remove(own.key); // it came into force
    return this.key === NEW ? null : read(NEW);
  }

  private keep(): void {
    const { key, name, base, text, notes } = this;
    if (!key || this.kept?.key === key) return;
    if (this.isNew || this.isChanged) write({ key, name, base, text, notes, at: Date.now() });
    else remove(key);
  }
}

function read(key: string): Kept | null {
  try {
    const kept = JSON.parse(localStorage.getItem(key) ?? "null") as Kept | null;
    return typeof kept?.text === "string" ? { ...kept, key } : null;
  } catch {
    return null; // unreadable drafts are ignored
  }
}
function write(kept: Kept): void {
  try {
    localStorage.setItem(kept.key, JSON.stringify(kept));
  } catch {
    // the browser's storage is full or shut: leaving the page asks all the same
  }
}
const remove = (key: string) => localStorage.removeItem(key);

export const draft = new Draft();
