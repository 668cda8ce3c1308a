// Requests to the server of this page, or to its worker. Errors become sentences.
import { host } from "./host";
import { place } from "./state/place.svelte";
import { said, words } from "./state/words.svelte";

function headers(): Record<string, string> {
  return place.token ? { Authorization: `Bearer ${place.token}` } : {};
}

/** As `fetch`, with a sentence where there is no server to answer. */
async function ask(path: string, more: RequestInit): Promise<Response> {
  try {
    return await host.now.request(path, more);
  } catch {
    throw new Error(words.t.link.noServer);
  }
}

async function read<T>(response: Response): Promise<T> {
  const text = await response.text();
  if (response.ok) return JSON.parse(text) as T;
  let sentence = `${response.status} ${response.statusText}`;
  try {
    sentence = said(JSON.parse(text) as object, "text") || sentence;
  } catch {
    // not JSON: the status is the only information
  }
  throw new Error(sentence);
}

export async function get<T>(path: string): Promise<T> {
  return read<T>(await ask(path, { headers: headers() }));
}

export async function post<T>(path: string, body: unknown): Promise<T> {
  const json = { ...headers(), "Content-Type": "application/json" };
  return read<T>(await ask(path, { method: "POST", headers: json, body: JSON.stringify(body) }));
}

/** Fetches a file with the token, and hands it to the reader under this name. */
export async function download(path: string, name: string): Promise<void> {
  const response = await ask(path, { headers: headers() });
  if (!response.ok) await read(response);
  save(await response.blob(), name);
}

export function save(content: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

export const saveText = (text: string, name: string, type = "text/plain") =>
  save(new Blob([text], { type: `${type};charset=utf-8` }), name);
