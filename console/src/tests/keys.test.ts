import { expect, test } from "vitest";
import { actionOf, type Focus } from "../keys";

const press = (key: string, more: Partial<KeyboardEvent> = {}) => ({
  key,
  code: "",
  ctrlKey: false,
  metaKey: false,
  altKey: false,
  shiftKey: false,
  ...more,
});

test.each<Focus>(["none", "number"])("Space stops while the focus is on: %s", (focus) => {
  expect(actionOf(press(" "), focus)).toBe("stop");
  expect(actionOf(press(" ", { shiftKey: true }), focus)).toBe("stop");
});

test("where text is written Space is a blank, and Shift and Space stop", () => {
  expect(actionOf(press(" "), "text")).toBe(null);
  expect(actionOf(press(" ", { shiftKey: true }), "text")).toBe("stop");
});

test("Space stops also while an input method for Chinese takes the keys", () => {
  expect(actionOf(press("Process", { code: "Space" }), "number")).toBe("stop");
  expect(actionOf(press("Process", { code: "Space", shiftKey: true }), "text")).toBe("stop");
});

test("a digit in a field for numbers opens no view", () => {
  expect(actionOf(press("2"), "number")).toBe(null);
  expect(actionOf(press("2"), "none")).toBe("messages");
});
