import { expect, test } from "vitest";
import { readPlace, tokenIn, writePlace } from "../place";

test("an address and the place it names are the same both ways", () => {
  const place = { view: "messages", message: "mcu:odometry", filter: "left ticks&=", from: 12.5, to: 20 } as const;
  expect(readPlace(writePlace(place))).toEqual(place);
});

test("the position in a recording is in the address, and belongs to it", () => {
  const place = { view: "link", recording: "run 1.mcap", at: 7.125, from: 2, to: 9.5 } as const;
  expect(readPlace(writePlace(place))).toEqual(place);
  expect(readPlace("#/link?recording=a.mcap&at=0")).toEqual({ view: "link", recording: "a.mcap", at: 0 });
  expect(readPlace("#/link?recording=a.mcap&at=x")).toEqual({ view: "link", recording: "a.mcap" });
  expect(readPlace("#/link?at=3")).toEqual({ view: "link" });
});

test("an address without a view shows the messages", () => {
  expect(readPlace("#/nowhere?from=x&to=3")).toEqual({ view: "messages" });
  expect(readPlace("")).toEqual({ view: "messages" });
});

test("a time range that is empty or reversed is none", () => {
  expect(readPlace("#/messages?from=5&to=5")).toEqual({ view: "messages" });
});

test("the token is read, and is never written into an address", () => {
  expect(tokenIn("#token=a%2Bb")).toBe("a+b");
  expect(tokenIn("#/messages?message=token")).toBeNull();
  expect(writePlace(readPlace("#token=secret"))).not.toContain("secret");
});
