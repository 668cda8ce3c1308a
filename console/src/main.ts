// Where the page begins.
import { mount } from "svelte";
import App from "./App.svelte";
import "./app.css";
import { Chinese } from "./chinese";
import { host } from "./host";
import { startPage } from "./page/client";
import { keepPresses } from "./press";
import { words } from "./state/words.svelte";

const target = document.getElementById("app");
if (!target) throw new Error("index.html has no element with the id app");
keepPresses(document);
const page = await startPage(document.getElementById("wirebond-page"));
if (page) {
  host.now = page;
  words.chinese = new Chinese(page.facts?.chinese ?? "");
}
mount(App, { target });
