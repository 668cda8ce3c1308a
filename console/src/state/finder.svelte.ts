// Which baud rate and which known format a device has that no file describes. A search goes on in other views.
import { post } from "../http";
import { live } from "./live.svelte";
import { session } from "./session.svelte";
import { words } from "./words.svelte";

export interface Match {
  name: string;
  path: string;
  share: number;
  frames: number;
  text: string;
}
/** A format whose payload has `payload` bytes here, and `told` in its file. */
export interface OtherSize {
  format: string;
  file: string;
  payload: number;
  told: number;
}
interface Found {
  matches: Match[];
  formats_tried: number;
  other_sizes: OtherSize[];
  inferred: string | null;
}
interface Line {
  baud: number;
  parity: string;
  stop_bits: number;
}
const SECONDS = 10; // of bytes that the formats are tried on
const EACH = 0.5; // seconds that each baud rate is listened to

class Finder {
  isBusy = $state(false);
  /** The port whose baud rates are tried: it is disconnected in that time. */
  port = $state<string | null>(null);
  matches = $state.raw<Match[] | null>(null);
  otherSizes = $state.raw<OtherSize[]>([]);
  /** A first protocol file for bytes that no format fits. */
  inferred = $state<string | null>(null);
  line = $state.raw<Line | null>(null);
  tried = $state(0); // formats
  problem = $state("");

  /** Tries the known formats on the last bytes. */
  async formats(): Promise<void> {
    await this.doing(async () => {
      const found = await post<Found>("api/identify", { live: SECONDS });
      this.matches = found.matches;
      this.otherSizes = found.other_sizes;
      this.inferred = found.inferred;
      this.tried = found.formats_tried;
      this.line = null;
    });
  }

  /** Tries all usual baud rates; then the port is connected with the likeliest one. */
  async rates(): Promise<void> {
    const { port, baud } = live.link ?? {};
    if (!port) return;
    await this.doing(async () => {
      await post("api/disconnect", { over: false });
      this.port = port;
      let best = baud;
      try {
        const found = await post<{ matches: Match[]; formats_tried: number; line: Line }>("api/identify", {
          port,
          seconds: EACH,
        });
        this.matches = found.matches;
        this.tried = found.formats_tried;
        this.line = found.line;
        best = found.line.baud;
      } finally {
        await post("api/connect", { port, baud: best });
      }
    });
    this.port = null;
  }

  /** Connects the port with the file of a known format. */
  async use(match: Match): Promise<void> {
    const body = { port: live.link?.port, baud: live.link?.baud, protocol: match.path };
    if (await session.attempt(post("api/connect", body))) await live.loadProtocol();
  }

  lineText(): string {
    const { line } = this;
    if (!line) return "";
    return words.t.device.line(
      line.baud,
      `8${line.parity === "none" ? "N" : line.parity[0]!.toUpperCase()}${line.stop_bits}`,
    );
  }

  private async doing(work: () => Promise<void>): Promise<void> {
    this.isBusy = true;
    this.problem = "";
    this.matches = null;
    this.otherSizes = [];
    this.inferred = null;
    try {
      await work();
    } catch (error) {
      this.problem = error instanceof Error ? error.message : String(error);
    }
    this.isBusy = false;
  }
}
export const finder = new Finder();
