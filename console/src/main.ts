// Where the page begins.
import { mount } from "svelte";
import App from "./App.svelte";
import "./app.css";
import { host } from "./host";
import { startPage } from "./page/client";
import { keepPresses } from "./press";

const target = document.getElementById("app");
if (!target) throw new Error("index.html has no element with the id app");
keepPresses(document);
host.now = (await startPage(document.getElementById("wirebond-page"))) ?? host.now;
mount(App, { target });
