import { expect, test } from "vitest";
import { Chinese } from "../chinese";

const files = import.meta.glob<string>("../../../python/src/wirebond/translations/zh/*.txt", {
  query: "?raw",
  import: "default",
  eager: true,
});
const tables = Object.values(files);
const ofPage = ["link", "server", "values", "recordings", "system", "page"].map((name) => {
  return files[`../../../python/src/wirebond/translations/zh/${name}.txt`];
});
const page = new Chinese(ofPage.join("\n\n"));

test("every sentence of the tables is found", () => {
  const missed: string[] = [];
  let count = 0;
  for (const table of tables) {
    const all = new Chinese(table);
    for (const block of table.trim().split(/\n\s*\n/)) {
      const english = block.split("\n").find((line) => !line.startsWith("#"));
      if (english === undefined) continue;
      count++;
      const said = english.replaceAll(/\{[~#]?\w+\}/g, "7");
      if (all.find(said) === null) missed.push(said);
    }
  }
  expect(missed).toEqual([]);
  expect(count).toBeGreaterThan(500);
});

test("names are taken over, and sentences within a sentence are translated", () => {
  expect(page.find("velocity was not sent: the emergency stop holds; release it first")).toMatch(/^velocity .*急停/);
  expect(page.find("velocity was not sent: no port is connected; choose one first")).not.toMatch(/no port/);
});

test("what has no pair stays as it is", () => {
  expect(page.find("a sentence of nobody")).toBeNull();
  expect(page.find("x".repeat(3000))).toBeNull();
});
