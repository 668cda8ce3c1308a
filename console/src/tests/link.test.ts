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
      late: (what) => `${what} was late`,
      lost: (what) => `lost before ${what}`,
      noReply: () => "no reply",
      said: (message) => String(message.text),
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
  last().say({ re: 0, t: 12.5, tick: 7, ok: { control: { holder: null, is_own: false } } });
}

test("it attaches with the token, asks for control by name only, and wants no messages", () => {
  expect(last().sent[0]).toMatchObject({ do: "attach", token: "secret", asks: true, messages: "none", version: 1 });
  expect(link.phase).toBe("attached");
  expect(last().of("take")).toEqual([]);
});

test("a decision before the first tick carries the one of the attach", () => {
  link.ask("take", { over: false }).catch(() => {});
  expect(last().of("take")[0]).toMatchObject({ tick: 7 });
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

test("it beats at once when it is in control, and each 100 ms", () => {
  vi.advanceTimersByTime(500);
  expect(last().of("beat")).toEqual([]);
  last().say({ event: "control", holder: "page", yours: true, why: "taken" });
  vi.advanceTimersByTime(500);
  expect(last().of("beat")).toHaveLength(6);
  last().say({ event: "control", holder: "other", yours: false, why: "taken over" });
  vi.advanceTimersByTime(500);
  expect(last().of("beat")).toHaveLength(6);
});

test("after a lost connection it attaches again, without control, and what waited has failed", async () => {
  last().say({ event: "control", holder: "page", yours: true, why: "taken" });
  const waiting = link.ask("release");
  last().onclose?.({ reason: "" });
  await expect(waiting).rejects.toMatchObject({ word: "down", message: "lost before release" });
  expect(control).toMatchObject({ yours: false, why: "connection" });
  vi.advanceTimersByTime(250);
  expect(sockets).toHaveLength(2);
  attach();
  vi.advanceTimersByTime(500);
  expect(last().sent.map((message) => message.do)).toEqual(["attach"]);
});

const refuseNewest = (what: string) => {
  const { id } = last().of(what).at(-1)!;
  last().say({ re: id, error: "late", text: "it was under way for long" });
};

test("a decision that came too late is sent once more, with the next tick", async () => {
  const asked = link.decide("take", { over: false }, () => true);
  refuseNewest("take");
  await vi.advanceTimersByTimeAsync(0);
  expect(last().of("take")).toHaveLength(1);
  last().say({ event: "tick", tick: 90 });
  await vi.advanceTimersByTimeAsync(0);
  expect(last().of("take")).toMatchObject([{ tick: 7 }, { over: false, tick: 90 }]);
  last().say({ re: last().of("take")[1]!.id, ok: null });
  await expect(asked).resolves.toBe(null);
});

test("what is late twice says so, and is not sent a third time", async () => {
  const asked = link.decide("release_stop", { over: "pad" }, () => true);
  asked.catch(() => {});
  refuseNewest("release_stop");
  await vi.advanceTimersByTimeAsync(300); // no tick comes
  expect(last().of("release_stop")).toHaveLength(2);
  refuseNewest("release_stop");
  await expect(asked).rejects.toMatchObject({ word: "late", message: "release_stop was late" });
  await vi.advanceTimersByTimeAsync(1000);
  expect(last().of("release_stop")).toHaveLength(2);
});

test.each(["it is not meant any more", "there is another connection"])(
  "nothing is sent again where %s",
  async (why) => {
    let isMeant = true;
    const asked = link.decide("take", { over: false }, () => isMeant);
    asked.catch(() => {});
    refuseNewest("take");
    await vi.advanceTimersByTimeAsync(0);
    if (why === "it is not meant any more") isMeant = false;
    else {
      last().onclose?.({ reason: "" });
      await vi.advanceTimersByTimeAsync(250);
      attach();
    }
    last().say({ event: "tick", tick: 90 });
    await expect(asked).rejects.toMatchObject({ word: "late", message: "take was late" });
    expect(sockets.flatMap((socket) => socket.of("take"))).toHaveLength(1);
  },
);

test("the refusal to release a stop names the program that stopped", async () => {
  const asked = link.decide("release_stop", { over: false }, () => true);
  const told = { error: "stopped_by_other", text: "pad stopped the robot", by: "pad" };
  last().say({ re: last().of("release_stop")[0]!.id, ...told });
  await expect(asked).rejects.toMatchObject({ word: "stopped_by_other", by: "pad" });
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

test("a request that a stall made too late goes out once, with the next tick", async () => {
  vi.advanceTimersByTime(300); // the server was not heard
  const asked = link.request("param_set", { id: 3 });
  await vi.advanceTimersByTimeAsync(0);
  expect(last().of("send")).toHaveLength(0);
  last().say({ event: "tick", tick: 90 });
  await vi.advanceTimersByTimeAsync(0);
  expect(last().of("send")).toMatchObject([{ message: "param_set", tick: 90 }]);
  last().say({ event: "reply", request: last().of("send")[0]!.id, offset: 900 });
  last().say({ event: "message", offset: 900, name: "param_value", fields: { id: 3 } });
  await expect(asked).resolves.toMatchObject({ name: "param_value" });
});

test("a request that the server refuses as too late is sent once more, and its reply is that of the second", async () => {
  const asked = link.request("param_set", { id: 3 });
  refuseNewest("send");
  await vi.advanceTimersByTimeAsync(0);
  last().say({ event: "tick", tick: 90 });
  await vi.advanceTimersByTimeAsync(0);
  const [first, second] = last().of("send");
  expect(second).toMatchObject({ message: "param_set", tick: 90 });
  last().say({ event: "reply", request: first!.id, offset: 800 });
  last().say({ event: "message", offset: 800, name: "param_value", fields: { id: 2 } });
  last().say({ event: "reply", request: second!.id, offset: 900 });
  last().say({ event: "message", offset: 900, name: "param_value", fields: { id: 3 } });
  await expect(asked).resolves.toMatchObject({ fields: { id: 3 } });
});

test("a request is given up where the server stays silent", async () => {
  vi.advanceTimersByTime(300);
  const asked = link.request("param_set", { id: 3 });
  asked.catch(() => {});
  await vi.advanceTimersByTimeAsync(300);
  await expect(asked).rejects.toMatchObject({ word: "late", message: "stale" });
  expect(last().of("send")).toHaveLength(0);
});

test("a page that hears nothing for 1 s is not in control, whatever the server thinks, and a stop still leaves", async () => {
  last().say({ event: "control", holder: "page", yours: true, why: "taken" });
  vi.advanceTimersByTime(1200);
  expect(link.phase).toBe("silent");
  expect(control).toEqual({ holder: null, yours: false, why: "unheard", releasedBy: null });
  const beats = last().of("beat").length;
  vi.advanceTimersByTime(500);
  expect(last().of("beat")).toHaveLength(beats);
  await expect(link.command("send", { message: "velocity" })).rejects.toMatchObject({ word: "down" });
  await expect(link.ask("take")).rejects.toMatchObject({ word: "down" });
  link.stop().catch(() => {});
  expect(last().of("emergency_stop")).toHaveLength(1);
});

test("what comes again after a silence gives no control back", () => {
  last().say({ event: "control", holder: "page", yours: true, why: "taken" });
  vi.advanceTimersByTime(1200);
  last().say({ event: "tick", tick: 60 });
  expect(link.phase).toBe("attached");
  expect(link.hasControl).toBe(false);
  vi.advanceTimersByTime(500);
  expect(last().of("take")).toEqual([]);
});

test("a connection that stays silent for 3 s is given up for another, and so is one that never opens", async () => {
  const stop = link.stop();
  vi.advanceTimersByTime(3100);
  await expect(stop).rejects.toBeInstanceOf(Refusal);
  expect(link.phase).toBe("lost");
  vi.advanceTimersByTime(300);
  expect(sockets).toHaveLength(2);
  vi.advanceTimersByTime(3100 + 500);
  expect(sockets).toHaveLength(3);
  attach();
  expect(link.phase).toBe("attached");
});
