// Which key does what. One table: the handler and the list that `?` shows read it.
import type { ViewName } from "./place";

export type Action = "stop" | "help" | "pause" | "theme" | "language" | "control" | "filter" | ViewName;

export const KEYS: readonly { key: string; action: Action }[] = [
  { key: " ", action: "stop" },
  { key: "1", action: "link" },
  { key: "2", action: "messages" },
  { key: "3", action: "plots" },
  { key: "4", action: "control" },
  { key: "5", action: "tuning" },
  { key: "6", action: "recordings" },
  { key: "7", action: "protocol" },
  { key: "p", action: "pause" },
  { key: "/", action: "filter" },
  { key: "c", action: "control" },
  { key: "d", action: "theme" },
  { key: "l", action: "language" },
  { key: "?", action: "help" },
];

/** What this key press means, given where the focus is. Space stops everywhere but where text is written. */
export function actionOf(event: Pick<KeyboardEvent, "key" | "ctrlKey" | "metaKey" | "altKey">, isWriting: boolean) {
  if (event.ctrlKey || event.metaKey || event.altKey || isWriting) return null;
  return KEYS.find((entry) => entry.key === event.key)?.action ?? null;
}

/** Does the focused element take text, so that letters and Space belong to it? */
export function takesText(element: Element | null): boolean {
  if (element instanceof HTMLTextAreaElement) return true;
  if (element instanceof HTMLElement && element.isContentEditable) return true;
  const others = ["checkbox", "radio", "range", "button", "file", "color", "submit"];
  return element instanceof HTMLInputElement && !others.includes(element.type);
}
