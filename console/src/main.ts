// Where the page begins.
import { mount } from "svelte";
import App from "./App.svelte";
import "./app.css";
import { keepPresses } from "./press";

const target = document.getElementById("app");
if (!target) throw new Error("index.html has no element with the id app");
keepPresses(document);
mount(App, { target });
