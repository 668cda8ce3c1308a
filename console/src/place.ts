// The address behind `#`, to values and back: `#/messages?message=odometry&from=12.5&to=20`.
export const VIEWS = ["link", "messages", "plots", "control", "tuning", "recordings", "protocol"] as const;
export type ViewName = (typeof VIEWS)[number];

export interface Place {
  view: ViewName;
  message?: string; // selected
  filter?: string;
  from?: number; // seconds; without both: live
  to?: number;
  recording?: string; // shown instead of the live link
  at?: number; // seconds: where the reader is in the recording; without it: at its end
}

export function readPlace(hash: string): Place {
  const [path = "", query = ""] = hash.replace(/^#\/?/, "").split("?", 2);
  const keys = new URLSearchParams(query);
  const view = VIEWS.find((name) => name === path) ?? "messages";
  const place: Place = { view };
  for (const key of ["message", "filter", "recording"] as const) {
    const text = keys.get(key);
    if (text) place[key] = text;
  }
  const from = number(keys.get("from"));
  const to = number(keys.get("to"));
  if (from !== null && to !== null && from < to) Object.assign(place, { from, to });
  const at = number(keys.get("at"));
  if (at !== null && place.recording) place.at = at;
  return place;
}

export function writePlace(place: Place): string {
  const keys = new URLSearchParams();
  for (const key of ["recording", "message", "filter"] as const) if (place[key]) keys.set(key, place[key]);
  if (place.from !== undefined && place.to !== undefined) {
    keys.set("from", place.from.toFixed(4));
    keys.set("to", place.to.toFixed(4));
  }
  if (place.at !== undefined && place.recording) keys.set("at", place.at.toFixed(4));
  const query = keys.toString();
  return `#/${place.view}${query ? `?${query}` : ""}`;
}

/** The token in `#token=…`, as the server prints it. */
export function tokenIn(hash: string): string | null {
  return new URLSearchParams(hash.replace(/^#\/?/, "")).get("token");
}

function number(text: string | null): number | null {
  const value = text === null || text === "" ? NaN : Number(text);
  return Number.isFinite(value) ? value : null;
}
