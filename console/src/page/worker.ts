// The page's worker: it has the port, the engine and the recordings, and answers the page as a server would. So a page
// whose thread stalls cannot drive a robot on, and one that draws much delays nothing.
import { fromBase64 } from "./base64";
import { Clock } from "./clock";
import { bytesOf, Desk } from "./desk";
import { Engine, HOST, MCU } from "./engine";
import { explain } from "./explain";
import { VERSION, type Facts } from "./facts";
import { RateMeter } from "./rates";
import { Recorder } from "./recorder";
import { aboutFile, addRecording, openReplay } from "./replay";
import { RefusedError, Robot, type Port, type Ports } from "./robot";
import { Rounds, type Replay, type Scene } from "./rounds";
import { samplesAsCsv } from "./samples";
import { Source, plain } from "./source";
import { openStore, type Store } from "./store";
import type { Taken } from "./tap";
import type { LinkView } from "../views";

/** Messages between the page and the worker. `id`: of a connection or of a request. */
export type ToWorker =
  | { kind: "begin"; module: ArrayBuffer; facts: Facts }
  | { kind: "open"; id: number; path: "attach" | "views" }
  | { kind: "said"; id: number; text: string }
  | { kind: "close"; id: number }
  | { kind: "ask"; id: number; path: string; body: unknown };
export type FromWorker =
  | { kind: "said"; id: number; data: string | ArrayBuffer }
  | { kind: "closed"; id: number }
  | { kind: "answer"; id: number; ok?: unknown; error?: string };

const LOOK_EVERY = 20; // ms
const STOP = "stop"; // the kept name of the page that stopped the robot
const QUIET = 0.1; // seconds: bytes that came so long ago are in the tap
const clock = new Clock();

class Page {
  private robot: Robot | null = null;
  private source: Source | null = null;
  private rates: RateMeter | null = null;
  private recorder: Recorder | null = null;
  private connecting: { port: string; why: string } | null = null;
  private lost = 0;
  private framesBefore = 0;
  private readonly rounds = new Map<number, Rounds>();
  private readonly replays = new Map<string, Promise<Replay>>();
  private deskId = 0;
  private readonly desk: Desk;
  private opening = 0;
  private readonly looking: ReturnType<typeof setInterval>;

  constructor(
    private readonly module: ArrayBuffer,
    readonly facts: Facts,
    private readonly store: Store,
    private readonly ports: Ports,
    private readonly post: (message: FromWorker, transfer?: Transferable[]) => void,
    stoppedBy: string | null,
  ) {
    const others = {
      record_start: () => this.record(),
      record_stop: () => this.stopRecording(),
      recordings: () => this.recordings(),
      annotate: () => {
        throw new RefusedError("refused", "a page cannot add notes; download the recording, then use `wirebond serve`");
      },
    };
    this.desk = new Desk(
      clock,
      () => this.robot,
      others,
      (message) => this.post({ kind: "said", id: this.deskId, data: JSON.stringify(message) }),
      stoppedBy,
      (by) => void store.keep(STOP, by).catch((error: Error) => this.sayNotKept(error)),
    );
    this.looking = setInterval(() => this.look(), LOOK_EVERY);
  }

  // ---- connections of the page

  open(id: number, path: "attach" | "views"): void {
    if (path === "attach") {
      this.desk.leave();
      this.deskId = id;
      return;
    }
    const say = (data: string | ArrayBuffer) =>
      this.post({ kind: "said", id, data }, typeof data === "string" ? [] : [data]);
    this.rounds.set(id, new Rounds(clock, () => this.scene, say));
  }

  said(id: number, text: string): void {
    const message = JSON.parse(text) as Record<string, unknown>;
    if (id === this.deskId) this.desk.take(message);
    else this.rounds.get(id)?.take(message);
  }

  close(id: number): void {
    if (id === this.deskId) this.desk.leave();
    this.rounds.delete(id);
  }

  private readonly scene: Scene = ((page: Page) => ({
    get source() {
      return page.source;
    },
    link: () => page.linkView(),
    short: () => page.short(),
    open: (name: string) => page.replay(name),
  }))(this);

  private sayNotKept(error: Error): void {
    const text = `the emergency stop holds, but it would be forgotten if this page were reloaded: ${error.message}`;
    this.source?.happenings.note(clock.now(), "stop_not_kept", { text });
  }

  // ---- the rhythm

  private look(): void {
    const { robot, source } = this;
    if (robot && source) {
      robot.look();
      this.takeFrom(robot, source);
    }
    this.desk.look();
    for (const rounds of this.rounds.values()) rounds.look();
  }

  private takeFrom(robot: Robot, source: Source): void {
    const taken = robot.take();
    this.lost += taken.lost;
    this.feed(source, taken);
    const { frames } = robot.account();
    this.recorder?.add(taken, frames - this.framesBefore);
    this.framesBefore = frames;
    const now = clock.now();
    source.look(now - QUIET);
  }

  private feed(source: Source, taken: Taken): void {
    const now = clock.now();
    let [sent, received] = [0, 0];
    for (const { t, received: upTo, sent: sentUpTo } of [
      ...taken.breaks,
      { t: null, received: taken.received.length, sent: taken.sent.length },
    ]) {
      source.feed(HOST, taken.sent.slice(sent, sentUpTo));
      source.feed(MCU, taken.received.slice(received, upTo));
      [sent, received] = [sentUpTo, upTo];
      if (t === null) break;
      source.breakStream(HOST);
      source.breakStream(MCU);
      source.history.addBreak(t);
    }
    if (taken.sent.length === 0) source.idle(HOST, now - QUIET);
    if (taken.received.length === 0) source.idle(MCU, now - QUIET);
    for (const { t, kind, facts } of taken.events) source.happenings.note(t, kind, facts);
  }

  // ---- the view of the link

  private short(): string {
    const { robot, desk } = this;
    if (!robot) return JSON.stringify(this.connecting);
    return [robot.state, robot.why, robot.isStopped, desk.holder, this.recorder?.name].join();
  }

  private linkView(): LinkView | Record<string, unknown> {
    const t = clock.now();
    const wall = Date.now() / 1000;
    const { robot, source, desk } = this;
    if (!robot || !source) return { t, wall, connected: false, connecting: this.connecting };
    const account = plain(robot.account()) as ReturnType<Robot["account"]>;
    const kept = source.history.range();
    const { send, late, held_back, reconnects, echoed_bytes, collisions, ...receive } = account;
    return {
      t,
      wall,
      connected: true,
      state: robot.state,
      why: robot.why,
      heard: source.heard(MCU),
      protocol: this.facts.protocol.name,
      hash: this.facts.protocol.hash,
      port: robot.portName,
      baud: robot.baud,
      line: null,
      holder: desk.holder,
      clients: desk.isPresent ? 1 : 0,
      stopped: robot.isStopped,
      stopped_by: robot.isStopped ? desk.stoppedBy : null,
      struck: robot.struck(),
      mcu_deadlines: source.mcuDeadlines.states(t),
      rates: this.rates!.rates(account, t),
      receive,
      send,
      late,
      held_back,
      reconnects,
      echoed_bytes,
      collisions,
      peer: { state: robot.peer.state, why: robot.peer.why },
      clock: null,
      round_trip: source.trips.figures(t),
      recording: this.recorder ? this.recordingOf(this.recorder) : null,
      history: { bytes: source.bytes, most: source.history.most, from: kept?.[0] ?? null, lost: this.lost },
    };
  }

  // ---- requests

  async ask(path: string, body: unknown): Promise<unknown> {
    const url = new URL(path, "http://page/");
    const name = decodeURIComponent(url.pathname.split("/")[3] ?? "");
    switch (url.pathname.split("/")[2]) {
      case "protocol":
        if (!url.searchParams.has("recording") && !this.robot)
          throw new Error("no port is connected; choose one first");
        return this.facts.protocol;
      case "document":
        return this.facts.document;
      case "lint":
        return this.facts.lint;
      case "connect":
        return this.connect(body as { place: number; baud: number | null });
      case "disconnect":
        return this.disconnect();
      case "recordings":
        if (!name) return { folder: null, recordings: await this.recordings() };
        if (name.endsWith(".csv")) return this.recordedCsv(name.slice(0, -4), url.searchParams);
        return this.store.read(name);
      case "explain": {
        const { bytes, sender } = body as { bytes: string; sender: "host" | "mcu" | null };
        const source = this.source ?? (await [...this.replays.values()].at(-1))?.source;
        if (!source) throw new Error("no port is connected; choose one first");
        return explain(source, bytesOf(bytes), sender);
      }
      case "add": {
        const added = body as { name: string; file: Blob };
        return addRecording(this.store, added.name, added.file);
      }
      case "samples.csv":
        return this.samples(url.searchParams);
    }
    throw new Error(`a page without a server cannot do this (${url.pathname}); use \`wirebond serve --web\` for it`);
  }

  /** `place`: of the port among those that the page may use. */
  private async connect({ place, baud }: { place: number; baud: number | null }): Promise<unknown> {
    await this.disconnect();
    const port = (await this.ports.getPorts())[place];
    if (!port) throw new Error("the browser does not give this page the port any more; choose it again");
    const opening = ++this.opening;
    const engine = await Engine.load(this.module);
    engine.open(fromBase64(this.facts.tables));
    const robot = new Robot(engine, this.facts, clock, baud ?? this.facts.protocol.link.baud);
    this.connecting = { port: "serial port", why: "" };
    try {
      await robot.connect(port, this.ports);
    } catch (error) {
      await robot.end();
      throw new Error(
        `the port cannot be opened: ${(error as Error).message} Close other programs and tabs that use it, then try again`,
      );
    } finally {
      this.connecting = null;
    }
    if (opening !== this.opening) {
      await robot.end();
      return null;
    }
    // A stop holds until a person releases it, whatever was closed in between.
    if (this.desk.stoppedBy !== null && this.facts.stops.length > 0) robot.stop();
    this.robot = robot;
    this.framesBefore = 0;
    this.source = new Source(engine, this.facts);
    this.rates = new RateMeter(this.facts.protocol, robot.baud);
    return { ok: null };
  }

  private async disconnect(): Promise<unknown> {
    this.opening++;
    await this.stopRecording();
    const { robot } = this;
    this.desk.forget();
    this.robot = null;
    this.source = null;
    await robot?.end();
    return { ok: null };
  }

  /** A page of another protocol takes its place. */
  async end(): Promise<void> {
    clearInterval(this.looking);
    this.desk.leave();
    await this.disconnect();
  }

  /** The browser has a port more. */
  appeared(): void {
    this.robot?.appeared();
  }

  // ---- recordings

  private async record(): Promise<unknown> {
    const { robot } = this;
    if (!robot) throw new RefusedError("down", "no port is connected; choose one first");
    if (this.recorder && this.recorder.seconds === null) {
      throw new RefusedError("refused", "the page records already; stop that recording first");
    }
    this.recorder = await Recorder.start(this.store, this.facts, clock, robot.portName, robot.baud);
    return this.recordingOf(this.recorder);
  }

  private async stopRecording(): Promise<unknown> {
    const { recorder } = this;
    if (!recorder) return null;
    if (this.robot && this.source) this.takeFrom(this.robot, this.source); // up to this moment
    await recorder.close();
    this.recorder = null;
    return this.recordingOf(recorder);
  }

  private recordingOf(recorder: Recorder): Record<string, unknown> {
    const { name, size, messages, error, startedWall: started } = recorder;
    const state = recorder.seconds === null ? "recording" : error ? "unclosed" : "closed";
    const seconds = recorder.seconds ?? clock.now() - recorder.started;
    const { name: protocol, hash } = this.facts.protocol;
    const lost_bytes = recorder.lost;
    return { name, path: name, state, started, seconds, size, protocol, hash, notes: [], messages, lost_bytes, error };
  }

  private async recordings(): Promise<unknown[]> {
    const found: Record<string, unknown>[] = [];
    for (const name of await this.store.names()) {
      if (name === this.recorder?.name) {
        found.push(this.recordingOf(this.recorder));
        continue;
      }
      const more = { name, path: name, seconds: null, notes: [], messages: null, lost_bytes: 0 };
      try {
        const file = await this.store.read(name);
        const about = await aboutFile(file);
        const state = about ? "closed" : "unreadable";
        const { protocol = "", hash = "", started = 0 } = about ?? {};
        found.push({ ...more, state, started, size: file.size, protocol, hash, error: "" });
      } catch (error) {
        const { message } = error as Error;
        found.push({ ...more, state: "unreadable", started: 0, size: 0, protocol: "", hash: "", error: message });
      }
    }
    return found.sort((a, b) => (b.started as number) - (a.started as number));
  }

  private replay(name: string): Promise<Replay> {
    let found = this.replays.get(name);
    if (!found) {
      found = this.store.read(name).then((file) => openReplay(name, file, this.module, this.facts));
      this.replays.clear(); // one at a time: it is kept whole
      this.replays.set(name, found);
      found.catch(() => this.replays.delete(name));
    }
    return found;
  }

  private async recordedCsv(name: string, asked: URLSearchParams): Promise<Blob> {
    const { source } = await this.replay(name);
    const message = asked.get("message") ?? "";
    const sender = asked.get("sender");
    const track = source.history.tracks.find(
      (one) => one.name === message && (sender === null || one.sender === (sender === "host" ? HOST : MCU)),
    );
    if (!track) throw new Error(`the protocol has no message ${message}; choose one of the list`);
    const prefix = track.sender === HOST ? "host:" : "";
    return samplesAsCsv(
      source,
      track.columns.map((column) => `${prefix}${message}.${column}`),
      -Infinity,
      Infinity,
      0,
    );
  }

  private async samples(asked: URLSearchParams): Promise<Blob> {
    const recording = asked.get("recording");
    const source = recording === null ? this.source : (await this.replay(recording)).source;
    if (!source) throw new Error("no port is connected; choose one first");
    const fields = (asked.get("fields") ?? "").split(",").filter((field) => field);
    const time = (key: string, otherwise: number) => (asked.has(key) ? Number(asked.get(key)) : otherwise);
    const zero = recording === null ? clock.wallAhead : 0;
    return samplesAsCsv(source, fields, time("from", -Infinity), time("to", Infinity), zero);
  }
}

/** What this file uses of a worker's global scope. */
declare const self: {
  postMessage(message: FromWorker, transfer?: Transferable[]): void;
  onmessage: ((event: MessageEvent<ToWorker>) => void) | null;
};
const serial = navigator.serial as Serial | undefined;
serial?.addEventListener("connect", () => page?.appeared());
let page: Page | null = null;
let opened: Promise<Store> | null = null; // one for all pages, so that recordings in memory stay
const early: ToWorker[] = []; // that came before the page had begun

function take(message: ToWorker): void {
  if (!page) {
    early.push(message);
    return;
  }
  const post = (answer: FromWorker) => self.postMessage(answer);
  switch (message.kind) {
    case "open":
      page.open(message.id, message.path);
      return;
    case "said":
      page.said(message.id, message.text);
      return;
    case "close":
      page.close(message.id);
      return;
    case "ask":
      page.ask(message.path, message.body).then(
        (ok) => post({ kind: "answer", id: message.id, ok }),
        (error: Error) => post({ kind: "answer", id: message.id, error: error.message }),
      );
  }
}

self.onmessage = (event: MessageEvent<ToWorker>) => {
  const message = event.data;
  if (message.kind !== "begin") {
    take(message);
    return;
  }
  const { module, facts } = message;
  if (facts.version !== VERSION)
    throw new Error("the page and its protocol are of different releases; make both again");
  const before = page;
  page = null;
  void Promise.all([(opened ??= openStore()), before?.end()]).then(async ([store]) => {
    const ports: Ports = { getPorts: () => (serial ? (serial.getPorts() as Promise<Port[]>) : Promise.resolve([])) };
    const say = (answer: FromWorker, transfer: Transferable[] = []) => self.postMessage(answer, transfer);
    const kept = await store.kept(STOP);
    page = new Page(module, facts, store, ports, say, kept === "" ? "a page that is not known any more" : kept);
    for (const one of early.splice(0)) take(one);
  });
};
