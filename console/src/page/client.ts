// The side of a page without a server that has the window: starts the worker, and speaks to it as to a server.
import { serial as overUsb } from "web-serial-polyfill";
import type { Host } from "../host";
import type { Socket } from "../lasting";
import { said } from "../state/words.svelte";
import { fromBase64 } from "./base64";
import type { Facts } from "./facts";
import { portName } from "./portname";
import type { FromWorker, ToWorker } from "./worker";
import workerUrl from "./worker?worker&url";

/** What the page's document says of itself: addresses of its parts, or (in one file) the parts. */
interface Config {
  protocol: string | Facts;
  engine: string; // an address
  inline?: { engine: string; worker: string }; // base64
}
/** What a page uses of `navigator.serial`. */
interface Chooser {
  requestPort(): Promise<SerialPort>;
  getPorts(): Promise<SerialPort[]>;
}

/** Ports of this browser; null: it has no way to a serial port. On Android only USB devices of the class CDC. */
export function chooser(): Chooser | null {
  if ("serial" in navigator) return navigator.serial;
  return "usb" in navigator ? (overUsb as unknown as Chooser) : null;
}

/** Starts the worker, if the document is a page without a server. */
export async function startPage(element: HTMLElement | null): Promise<PageHost | null> {
  if (!element?.textContent) return null;
  const config = JSON.parse(element.textContent) as Config;
  const { inline } = config;
  const script = inline ? new Blob([fromBase64(inline.worker) as BlobPart], { type: "text/javascript" }) : null;
  const page = new PageHost(new Worker(script ? URL.createObjectURL(script) : new URL(workerUrl, document.baseURI)));
  const [module, facts] = await Promise.all([
    inline ? (fromBase64(inline.engine).buffer as ArrayBuffer) : fetch(config.engine).then((one) => one.arrayBuffer()),
    typeof config.protocol === "string"
      ? fetch(config.protocol).then((one) => one.json() as Promise<Facts>)
      : config.protocol,
  ]);
  page.begin(module, facts);
  return page;
}

type Waiting = { resolve(answer: Response): void; reject(error: Error): void };

export class PageHost implements Host {
  readonly isPage = true;
  facts: Facts | null = null;
  private ports: SerialPort[] = [];
  private next = 1;
  private module: ArrayBuffer | null = null;
  private readonly sockets = new Map<number, WorkerSocket>();
  private readonly asked = new Map<number, Waiting>();

  constructor(private readonly worker: Worker) {
    worker.onmessage = (event: MessageEvent<FromWorker>) => this.take(event.data);
    worker.onerror = (event) => {
      for (const { reject } of this.asked.values()) reject(new Error(event.message));
      this.asked.clear();
    };
  }

  begin(module: ArrayBuffer, facts: Facts): void {
    this.module = module;
    this.facts = facts;
    this.post({ kind: "begin", module, facts });
  }

  /** The port that a person chooses now, as the worker knows it; null: none. Call it from a click. */
  async choosePort(): Promise<number | null> {
    const from = chooser();
    if (!from) return null;
    let port: SerialPort;
    try {
      port = await from.requestPort();
    } catch (error) {
      if ((error as DOMException).name === "NotFoundError") return null; // the person closed the list
      throw error;
    }
    this.ports = await from.getPorts();
    return this.ports.indexOf(port);
  }

  /** The ports that the browser gives the page without asking. */
  async knownPorts(): Promise<string[]> {
    this.ports = (await chooser()?.getPorts()) ?? [];
    return this.ports.map((port) => portName(port.getInfo()));
  }

  /** From now on the page is of this protocol. */
  change(facts: Facts): void {
    this.begin(this.module!, facts);
    for (const socket of [...this.sockets.values()]) socket.close();
  }

  socket(path: "attach" | "views"): Socket {
    const id = this.next++;
    const socket = new WorkerSocket(
      (text) => this.post({ kind: "said", id, text }),
      () => {
        this.sockets.delete(id);
        this.post({ kind: "close", id });
      },
    );
    this.sockets.set(id, socket);
    this.post({ kind: "open", id, path });
    queueMicrotask(() => socket.opened());
    return socket;
  }

  request(path: string, more: RequestInit): Promise<Response> {
    return this.ask(path, typeof more.body === "string" ? JSON.parse(more.body) : null);
  }

  /** Keeps a recording that the person has as a file, and returns its name. */
  async addRecording(file: File): Promise<string> {
    const answer = await this.ask("api/add", { name: file.name, file });
    if (!answer.ok) throw new Error(said((await answer.json()) as object, "text"));
    return (await answer.json()) as string;
  }

  private ask(path: string, body: unknown): Promise<Response> {
    const id = this.next++;
    this.post({ kind: "ask", id, path, body });
    return new Promise((resolve, reject) => this.asked.set(id, { resolve, reject }));
  }

  private post(message: ToWorker): void {
    this.worker.postMessage(message);
  }

  private take(message: FromWorker): void {
    if (message.kind !== "answer") {
      const socket = this.sockets.get(message.id);
      if (message.kind === "said") socket?.onmessage?.({ data: message.data } as never);
      else socket?.close();
      return;
    }
    const waiting = this.asked.get(message.id);
    this.asked.delete(message.id);
    if (message.error !== undefined) {
      waiting?.resolve(Response.json({ error: "refused", text: message.error }, { status: 422 }));
    } else if (message.ok instanceof Blob) waiting?.resolve(new Response(message.ok));
    else waiting?.resolve(Response.json(message.ok ?? null));
  }
}

/** What the page's code for WebSockets needs of one. */
class WorkerSocket implements Socket {
  readyState: Socket["readyState"] = 0;
  onopen: Socket["onopen"] = null;
  onmessage: Socket["onmessage"] = null;
  onclose: Socket["onclose"] = null;

  constructor(
    private readonly say: (text: string) => void,
    private readonly end: () => void,
  ) {}

  opened(): void {
    if (this.readyState !== 0) return;
    this.readyState = 1;
    this.onopen?.({} as never);
  }

  send(data: string | ArrayBufferLike | Blob | ArrayBufferView): void {
    if (this.readyState === 1) this.say(data as string);
  }

  close(): void {
    if (this.readyState === 3) return;
    this.readyState = 3;
    this.end();
    this.onclose?.({ reason: "" } as never);
  }
}
