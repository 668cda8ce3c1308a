// Where the page's data comes from: the server that sent the page; or, for a page without a server, a worker of its own.
import type { Socket } from "./lasting";

export interface Host {
  /** There is no server: functions that need one are not offered. */
  readonly isPage: boolean;
  /** A connection to `attach` or `views`. */
  socket(path: "attach" | "views"): Socket;
  /** As `fetch`, of a path beside the page. Rejects if there is no answer. */
  request(path: string, more: RequestInit): Promise<Response>;
}

function address(path: string, scheme: "http" | "ws" = "http"): string {
  const url = new URL(path, location.href.replace(/#.*/, ""));
  if (scheme === "ws") url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  return url.href;
}

const server: Host = {
  isPage: false,
  socket: (path) => {
    const socket = new WebSocket(address(path, "ws"));
    socket.binaryType = "arraybuffer";
    return socket;
  },
  request: (path, more) => fetch(address(path), more),
};

/** The one in use. A page without a server sets its own before anything is shown. */
export const host: { now: Host } = { now: server };
