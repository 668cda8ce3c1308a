// Where the reader is: view, selection, time range, filter. It is the address behind `#`, so that a colleague who opens
// it sees the same. The token, which also comes there, is moved to this tab's own memory at once.
import { readPlace, tokenIn, writePlace, type Place, type ViewName } from "../place";

const TOKEN = "wirebond.token";
const SETTLED = 200; // ms: browsers refuse an address that changes with each picture

class PlaceState {
  now = $state<Place>(readPlace(location.hash));
  token = $state(takeToken());
  private timer: ReturnType<typeof setTimeout> | undefined;

  constructor() {
    addEventListener("hashchange", () => {
      clearTimeout(this.timer);
      const token = takeToken();
      if (token) this.token = token;
      this.now = readPlace(location.hash);
    });
  }

  /** Tries again with this token, or with that of an address that the reader copied whole. */
  useToken(text: string): void {
    sessionStorage.setItem(TOKEN, tokenIn(text.slice(text.indexOf("#") + 1)) ?? text.trim());
    location.reload();
  }

  /** Shows another view, of the same recording at the same position, with the same range; what belonged to the last view
   *  alone goes. */
  open(view: ViewName, more: Partial<Place> = {}): void {
    clearTimeout(this.timer);
    const { recording, at, from, to } = this.now;
    const isSame = !("recording" in more) || more.recording === recording;
    this.now = { view, ...(recording && isSame ? { recording, at, from, to } : {}), ...more };
    history.pushState(null, "", writePlace(this.now));
  }

  /** Changes a part of where we are. */
  set(more: Partial<Place>): void {
    clearTimeout(this.timer);
    this.now = { ...this.now, ...more };
    history.replaceState(null, "", writePlace(this.now));
  }

  /** The same for continuous changes: the address follows when they end. */
  slide(more: Partial<Place>): void {
    clearTimeout(this.timer);
    this.now = { ...this.now, ...more };
    this.timer = setTimeout(() => this.set({}), SETTLED);
  }
}
function takeToken(): string {
  const token = tokenIn(location.hash);
  if (token !== null) {
    sessionStorage.setItem(TOKEN, token);
    history.replaceState(null, "", writePlace(readPlace(location.hash)));
  }
  return sessionStorage.getItem(TOKEN) ?? "";
}
export const place = new PlaceState();
