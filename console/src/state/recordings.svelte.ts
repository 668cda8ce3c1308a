// The server's recordings, and which one is shown in place of the live link.
import { get } from "../http";
import { live } from "./live.svelte";
import { place } from "./place.svelte";

/** As `record_start` in docs/server.md. */
export interface Recorded {
  name: string;
  path: string;
  hash: string | null;
  state: "recording" | "closing" | "closed" | "unclosed" | "capture" | "unreadable";
  started: number | null;
  seconds: number | null;
  size: number;
  protocol: string | null;
  notes: { written: number; text: string }[];
  messages: number | null;
  lost_bytes: number;
  error: string | null;
}

class Recordings {
  all = $state.raw<Recorded[]>([]);
  folder = $state("");
  problem = $state("");
  /** Where the reader is in the recording; null: at its end, or none is shown. */
  readonly at = $derived(place.now.recording === undefined ? null : (place.now.at ?? null));

  async load(): Promise<void> {
    try {
      const found = await get<{ folder: string | null; recordings: Recorded[] }>("api/recordings");
      this.all = found.recordings;
      this.folder = found.folder ?? "";
      this.problem = "";
    } catch (error) {
      this.problem = error instanceof Error ? error.message : String(error);
    }
  }

  open(name: string): void {
    place.open("plots", { recording: name });
  }

  close(): void {
    place.set({ recording: undefined, at: undefined, from: undefined, to: undefined });
  }

  /** Follows the address: asks the server for the recording that it names, or for the live link. */
  follow(): void {
    void live.showRecording(place.now.recording ?? "");
  }

  /** Follows the address: asks for the data at its position. */
  seek(): void {
    live.want({ at: this.at ?? undefined });
  }

  scrub(at: number): void {
    place.slide({ at });
  }
}
export const recordings = new Recordings();
