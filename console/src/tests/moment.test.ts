import { expect, test } from "vitest";
import { momentOf } from "../moment";
import type { Protocol } from "../protocol";
import type { LinkEvent, Row } from "../views";

const event = (t: number, kind: string, more: Record<string, unknown> = {}): LinkEvent => ({
  t,
  kind,
  text: "",
  ...more,
});
const row = (name: string, t: number | null) => ({ name, sender: "host", t }) as Row;
const by = (message: string) => ({ message, fields: {}, header: {} });
const deadline = (then: string, recover: string, recover_by: unknown) =>
  ({ message: "velocity", at: "mcu", after: 1, then, recover, recover_by }) as Protocol["deadlines"][number];
const protocol = {
  deadlines: [deadline("stop", "next_message", null), deadline("safe_mode", "explicit", by("parameter"))],
} as Protocol;
const silent = (t: number, action: string) => event(t, "mcu_deadline_struck", { action, message: "velocity" });

test("a moment has what had begun and not ended, and nothing of later", () => {
  const marks = [
    event(1, "port_down"),
    event(2, "port_up"),
    event(3, "stopped"),
    event(3.5, "discarded", { direction: "received", bytes: 7 }),
    event(4, "deadline_struck", { action: "warn" }),
    event(5, "deadline_ended", { action: "warn" }),
    event(6, "released"),
    event(7, "discarded", { direction: "received", bytes: 5 }),
    event(8, "port_down"),
  ];
  const at = (t: number) => momentOf(marks, [], protocol, t);
  expect(at(1.5).away?.t).toBe(1);
  expect(at(4.5)).toMatchObject({ away: null, isStopped: true, discarded: { received: 7, sent: 0 } });
  expect(at(4.5).struck).toHaveLength(1);
  expect(at(6.5)).toMatchObject({ isStopped: false, struck: [] });
  expect(at(9)).toMatchObject({ away: { t: 8 }, discarded: { received: 12, sent: 0 } });
});

test("a deadline at the robot holds until its message comes again, or what ends it", () => {
  const marks = [silent(2, "stop"), silent(4, "safe_mode")];
  const names = (rows: Row[]) => momentOf(marks, rows, protocol, 6).struck.map((one) => one.action);
  expect(names([row("velocity", 1)])).toEqual(["stop", "safe_mode"]);
  expect(names([row("velocity", 5), row("parameter", null)])).toEqual(["safe_mode"]);
  expect(names([row("velocity", 5), row("parameter", 5.5)])).toEqual([]);
});
