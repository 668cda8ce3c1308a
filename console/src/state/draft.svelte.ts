// The protocol file that is edited: the one in force, or a first one of a device that no file describes. It stays while
// the reader looks at other views.
import type { Protocol } from "../protocol";
import { place } from "./place.svelte";

class Draft {
  name = $state("");
  base = $state(""); // the text that was begun with
  text = $state("");
  notes = $state.raw<string[]>([]); // what could not be told, of a file that was made
  isNew = $state(false); // no file of this text is in force
  /** Where the server wrote it last, and what. */
  saved = $state.raw<{ path: string; text: string } | null>(null);
  private hash = "";
  readonly isChanged = $derived(this.text !== this.base);

  /** Edits the protocol in force, unless its text is being edited already. */
  follow(protocol: Protocol): void {
    if (this.hash === protocol.hash) return;
    this.begin(protocol.name, protocol.text, [], protocol.hash);
    this.isNew = false;
  }

  /** Edits a first file, in the view of the protocol. */
  start(name: string, text: string, notes: string[] = []): void {
    this.begin(name, text, notes, "");
    this.isNew = true;
    place.open("protocol");
  }

  drop(): void {
    this.begin("", "", [], "");
    this.isNew = false;
  }

  private begin(name: string, text: string, notes: string[], hash: string): void {
    this.name = name;
    this.base = this.text = text;
    this.notes = notes;
    this.hash = hash;
    if (this.saved?.text !== text) this.saved = null;
  }
}
export const draft = new Draft();
