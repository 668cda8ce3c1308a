import { expect, test } from "vitest";
import { grouped, joined, toneOf } from "../marks";
import type { LinkEvent } from "../views";

const event = (t: number, kind: string, more: Record<string, unknown> = {}): LinkEvent => ({
  t,
  kind,
  text: "",
  ...more,
});

test("faults, deadlines, log lines and discards are marked, each with its weight", () => {
  const tones = [
    event(1, "stopped"),
    event(1, "port_down"),
    event(1, "discarded"),
    event(1, "mcu_deadline_struck"),
    event(1, "deadline_struck"),
    event(1, "mark"),
    ...["error", "warning", "info", "debug", "7"].map((level) => event(1, "log", { level })),
    event(1, "lease_begun"),
  ].map(toneOf);
  expect(tones).toEqual([
    ...["stop", "bad", "bad", "warn", "warn", "accent"],
    ...["bad", "warn", "muted", "muted", "muted"],
    null,
  ]);
});

test("a discard that goes on stands for what was told of it before", () => {
  const discard = (t: number, bytes: number, direction = "received") => event(t, "discarded", { bytes, direction });
  const before = [discard(1, 5), event(2, "mark"), discard(3, 4)];
  expect(joined(before, [discard(3, 9), discard(3, 1, "sent")]).map((mark) => mark.bytes)).toEqual([
    5,
    undefined,
    9,
    1,
  ]);
  expect(joined(before, [event(4, "mark")])).toHaveLength(4);
});

test("marks that lie too close are one, at the heaviest, and none covers another", () => {
  const marks = [
    event(0.5, "stopped"),
    ...Array.from({ length: 1000 }, (_, index) => event(index / 100, "discarded", { bytes: 3 })),
    event(10, "mark"),
    event(11, "mark"),
  ];
  const groups = grouped(marks, 0, 10, 0.5);
  expect(groups.reduce((sum, group) => sum + group.marks.length, 0)).toBe(1002);
  for (const [index, group] of groups.slice(1).entries())
    expect(group.t - groups[index]!.t).toBeGreaterThanOrEqual(0.5);
  expect(groups.length).toBeGreaterThan(10);
  expect(groups.filter((group) => !group.isSmall).map((group) => [group.t, group.tone])).toEqual([
    [0.5, "stop"],
    [10, "accent"],
  ]);
});

test("a group names its heaviest marks first, and a mark joins a group that is close enough", () => {
  const marks = [event(1.0, "mark"), event(1.1, "deadline_struck"), event(1.2, "port_down"), event(2.3, "mark")];
  const groups = grouped(marks, 0, 10, 1);
  expect(groups.map((group) => group.marks.map((mark) => mark.t))).toEqual([[1.2, 1.1, 1.0], [2.3]]);
  expect(groups.map((group) => [group.t, group.tone])).toEqual([
    [1.2, "bad"],
    [2.3, "accent"],
  ]);
  expect(grouped([event(3, "mark"), event(3, "mark")], 3, 3, 1e-9)).toHaveLength(1);
});
