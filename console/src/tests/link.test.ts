import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { AttachLink, Refusal, type Control, type Phase } from "../link";

class FakeSocket {
  readyState = 1;
  sent: Record<string, unknown>[] = [];
  onopen: (() => void) | null = null;
  onmessage: ((event: { data: string }) => void) | null = null;
  onclose: ((event: { reason: string }) => void) | null = null;
  send(text: string): void {
    this.sent.push(JSON.parse(text) as Record<string, unknown>);
  }
  close(): void {
    this.readyState = 3;
    this.onclose?.({ reason: "" });
  }
  say(message: Record<string, unknown>): void {
    this.onmessage?.({ data: JSON.stringify(message) });
  }
  of(what: string): Record<string, unknown>[] {
    return this.sent.filter((message) => message.do === what);
  }
}

let sockets: FakeSocket[];
let phases: Phase[];
let control: Control;
let link: AttachLink;
const last = () => sockets.at(-1)!;

beforeEach(() => {
  vi.useFakeTimers();
  sockets = [];
  phases = [];
  link = new AttachLink(
    () => {
      const socket = new FakeSocket();
      sockets.push(socket);
      return socket as unknown as WebSocket;
    },
    () => "secret",
    "page",
    { phase: (phase) => phases.push(phase), welcome: () => {}, control: (now) => (control = now), event: () => {} },
    {
      notAttached: () => "not attached",
      staleTick: () => "stale",
      noAnswer: () => "no answer",
      noReply: () => "no reply",
    },
    () => Date.now(),
  );
  link.connect();
  attach();
});
afterEach(() => {
  link.end();
  vi.useRealTimers();
});
function attach(): void {
  last().onopen?.();
  last().say({ re: 0, ok: { tick: 7, control: { holder: null, is_own: false } } });
}

test("it attaches with the token, asks for control by name only, and wants no messages", () => {
  expect(last().sent[0]).toMatchObject({ do: "attach", token: "secret", asks: true, messages: "none", version: 1 });
  expect(link.phase).toBe("attached");
  expect(last().of("take")).toEqual([]);
});

test("each command carries the newest tick", () => {
  last().say({ event: "tick", tick: 41 });
  link.command("send", { message: "velocity", fields: {} }).catch(() => {});
  expect(last().of("send")[0]).toMatchObject({ tick: 41 });
});

test("a page that heard no tick for 250 ms sends no command, but stops the robot", async () => {
  vi.advanceTimersByTime(300);
  await expect(link.command("send", { message: "velocity" })).rejects.toMatchObject({ word: "late" });
  expect(last().of("send")).toEqual([]);
  link.stop().catch(() => {});
  expect(last().of("emergency_stop")).toHaveLength(1);
});

test("it beats each 100 ms while it is in control, and only then", () => {
  vi.advanceTimersByTime(500);
  expect(last().of("beat")).toEqual([]);
  last().say({ event: "control", holder: "page", yours: true, why: "taken" });
  vi.advanceTimersByTime(500);
  expect(last().of("beat")).toHaveLength(5);
  last().say({ event: "control", holder: "other", yours: false, why: "taken over" });
  vi.advanceTimersByTime(500);
  expect(last().of("beat")).toHaveLength(5);
});

test("after a lost connection it attaches again, without control, and what waited has failed", async () => {
  last().say({ event: "control", holder: "page", yours: true, why: "taken" });
  const waiting = link.ask("release");
  last().onclose?.({ reason: "" });
  await expect(waiting).rejects.toBeInstanceOf(Refusal);
  expect(control.yours).toBe(false);
  vi.advanceTimersByTime(250);
  expect(sockets).toHaveLength(2);
  attach();
  vi.advanceTimersByTime(500);
  expect(last().sent.map((message) => message.do)).toEqual(["attach"]);
});

test("a refused token ends the attempts, with the server's own sentence", () => {
  last().onclose?.({ reason: "" });
  vi.advanceTimersByTime(250);
  last().onopen?.();
  last().say({ re: 0, error: "token", text: "the token is wrong" });
  last().onclose?.({ reason: "" });
  vi.advanceTimersByTime(60_000);
  expect(sockets).toHaveLength(2);
  expect(link.phase).toBe("refused");
});

test("a refusal comes in the server's words", async () => {
  const asked = link.ask("take", { over: false });
  last().say({ re: last().of("take")[0]!.id, error: "not_in_control", text: "pad is in control of the robot" });
  await expect(asked).rejects.toMatchObject({ word: "not_in_control", message: "pad is in control of the robot" });
});

test("a reply is the message with the offset that the server named", async () => {
  const asked = link.request("status_query", {});
  const id = last().of("send")[0]!.id as number;
  last().say({ re: id, ok: null });
  last().say({ event: "reply", request: id, offset: 900 });
  last().say({ event: "message", offset: 900, name: "status", fields: { battery: 12 } });
  await expect(asked).resolves.toMatchObject({ name: "status", fields: { battery: 12 } });
});
