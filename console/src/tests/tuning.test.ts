import { expect, test } from "vitest";
import { answering, asCpp, asYaml, isSame, readValues, refusal, sourcesOf } from "../parameters";
import type { Field, Message, Protocol } from "../protocol";
import { analyse, stillness } from "../step";

/** A second-order system's answer to a step from 0 to `gain` at t = 1. */
function response(damping: number, gain: number, frequency = 10) {
  const t = Array.from({ length: 2000 }, (_, index) => index * 0.002);
  const damped = frequency * Math.sqrt(1 - damping ** 2);
  const y = t.map((at) => {
    const since = at - 1;
    if (since < 0) return 0;
    const decay = Math.exp(-damping * frequency * since);
    return (
      gain * (1 - decay * (Math.cos(damped * since) + ((damping * frequency) / damped) * Math.sin(damped * since)))
    );
  });
  return { t, y };
}

test("rise time, overshoot, settling time and steady error are those of the formula", () => {
  const { t, y } = response(0.5, 2);
  const found = analyse(t, y, 1, 2.1);
  if (typeof found === "string") throw new Error(found);
  expect(found.overshoot).toBeCloseTo(Math.exp((-Math.PI * 0.5) / Math.sqrt(0.75)), 2); // 16.3 %
  expect(found.rise).toBeCloseTo(0.164, 2); // 1.64 / frequency at this damping
  expect(found.settling).toBeGreaterThan(0.45);
  expect(found.settling).toBeLessThan(0.6);
  expect(found.steadyError).toBeCloseTo(0.1, 3);
});

test("a step downwards is measured as one upwards", () => {
  const { t, y } = response(0.5, -2);
  const found = analyse(t, y, 1, null);
  if (typeof found === "string") throw new Error(found);
  expect(found.overshoot).toBeCloseTo(0.163, 2);
  expect(found.final).toBeCloseTo(-2, 2);
});

test("noise alone is not a response, and a few samples are too few", () => {
  const t = Array.from({ length: 200 }, (_, index) => index * 0.01);
  const y = t.map((_, index) => Math.sin(index * 12.9898) * 0.1);
  expect(analyse(t, y, 1, null)).toBe("no_response");
  expect(analyse([0, 1, 2], [0, 1, 1], 1, null)).toBe("too_few");
  expect(stillness(y)?.spread).toBeGreaterThan(0.05);
});

const field = (name: string, more: Partial<Field> = {}) =>
  ({
    name,
    kind: "number",
    is_integer: false,
    unit: null,
    count: null,
    max_count: null,
    is_count: false,
    is_time: false,
    default: null,
    values: null,
    ...more,
  }) as Field;
const message = (name: string, sender: "host" | "mcu", fields: Field[], reply: string | null = null) =>
  ({ name, sender, fields, reply, every: null, is_controlled: false }) as unknown as Message;
const index = field("idx", { is_integer: true });
const gains = ["p", "i", "d"].map((name) => field(name));
const pid = {
  parameters: null,
  services: [],
  messages: [
    message("pid", "host", [index, ...gains], "acknowledge"),
    message("read_gains", "host", [index], "gains"),
    message("gains", "mcu", [index, ...gains]),
    message("acknowledge", "mcu", [field("result", { kind: "enum", values: { accepted: 0, out_of_range: 2 } })]),
  ],
} as unknown as Protocol;

test("gains that a message sets are read back by the request whose reply has them", () => {
  const [source] = sourcesOf(pid);
  expect(source).toMatchObject({ name: "pid", read: { name: "read_gains" }, value: { name: "gains" } });
  expect(source?.selectors.map((one) => one.name)).toEqual(["idx"]);
  expect(source?.parameters.map((one) => one.key)).toEqual(["p", "i", "d"]);
});

test("a message that names its one value has a parameter for each name that is not a command", () => {
  const name = field("name", { kind: "enum", values: { clear: 0, max_linear: 1, max_angular: 2 } });
  const recover_by = { message: "parameter", fields: { name: "clear", value: 0 }, header: {} };
  const rover = {
    ...pid,
    messages: [message("parameter", "host", [name, field("value")])],
    deadlines: [{ message: "velocity", at: "mcu", after: 3, then: "safe_mode", recover: "explicit", recover_by }],
  } as Protocol;
  expect(sourcesOf(rover)[0]?.parameters).toMatchObject([
    { selector: { name: "max_linear" } },
    { selector: { name: "max_angular" } },
  ]);
});

test("elements of a group show what a change does, and a time stamp does not", () => {
  const positions = field("position", { unit: "rad", columns: ["legs.joints[0].position", "legs.joints[1].position"] });
  const joints = field("joints", { kind: "struct", columns: [], fields: [positions] });
  const measured = field("measured", { unit: "us", is_time: true, columns: ["legs.measured"] });
  const legs = { ...message("legs", "mcu", [measured, joints]), every: 0.02 };
  expect(answering({ ...pid, emergency_stop: [], messages: [legs] } as unknown as Protocol)).toEqual(positions.columns);
});

test("a result other than 0 is a refusal", () => {
  const acknowledge = pid.messages.find((one) => one.name === "acknowledge") ?? null;
  expect(refusal({ result: "accepted" }, acknowledge)).toBeNull();
  expect(refusal({ result: "out_of_range" }, acknowledge)).toBe("out_of_range");
});

test("what the wire rounds is the same value; what it does not is another", () => {
  expect(isSame(0.1, 0.10000000149011612, null)).toBe(true);
  expect(isSame(0.1, 0.1002, 0.001)).toBe(true);
  expect(isSame(0.1, 0.11, 0.001)).toBe(false);
});

test("a set is exported as YAML and as C++", () => {
  expect(asYaml({ p: 10, i: 0.5 })).toBe("p: 10\ni: 0.5\n");
  expect(asCpp({ p: 10, "d.x": 0.5 }, "my gains")).toContain(
    "inline constexpr float p = 10.0F;\ninline constexpr float d_x = 0.5F;",
  );
});

test("a set that was exported is read again, and so is what Python wrote; another file is told by its line", () => {
  const values = { kp: 1.5, "0": -2e-7 };
  expect(readValues(asYaml(values))).toEqual(values);
  expect(readValues("# Parameters of axis, as its MCU had them.\nkp: 1.5\r\n\nki: 2 # slow\n")).toEqual({
    kp: 1.5,
    ki: 2,
  });
  expect(readValues(JSON.stringify(values, null, 2))).toEqual(values);
  expect(() => readValues("kp: 1\nnot a value")).toThrow("not a value");
  expect(() => readValues("kp: fast")).toThrow("kp: fast");
  expect(() => readValues("{")).toThrow();
});
