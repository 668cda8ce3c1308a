// The keys and their actions. One table: the handler and the list that `?` shows read it.
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

/** Whose the keys are that the focused element gets: a text's, where Space is written too; a number's, where it never is. */
export type Focus = "none" | "number" | "text";
type Press = Pick<KeyboardEvent, "key" | "code" | "ctrlKey" | "metaKey" | "altKey" | "shiftKey">;

/** Is it the Space key? An input method, such as one for Chinese, reports its `key` as "Process". */
export const isSpace = (event: Pick<KeyboardEvent, "key" | "code">) => event.key === " " || event.code === "Space";

/** What this key press means, given where the focus is. Space stops everywhere; where a text is written, with Shift. */
export function actionOf(event: Press, focus: Focus): Action | null {
  if (event.ctrlKey || event.metaKey || event.altKey) return null;
  if (isSpace(event)) return focus !== "text" || event.shiftKey ? "stop" : null;
  return focus === "none" ? (KEYS.find((entry) => entry.key === event.key)?.action ?? null) : null;
}

const NO_TEXT = ["checkbox", "radio", "range", "button", "file", "color", "submit", "reset", "image"];
const NO_SPACE = ["number", "date", "time", "datetime-local", "month", "week"];

export function focusOf(element: Element | null): Focus {
  if (element instanceof HTMLTextAreaElement) return "text";
  if (element instanceof HTMLElement && element.isContentEditable) return "text";
  if (!(element instanceof HTMLInputElement) || NO_TEXT.includes(element.type)) return "none";
  return NO_SPACE.includes(element.type) ? "number" : "text";
}
