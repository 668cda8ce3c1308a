"""Is a page without a server small, soon there, and smooth, at 8 000 messages a second and with 2 Mbaud of noise?

Headless Chromium, and a double of Web Serial that is joined to a pty (tests/page). The page shows its table of messages
above two plots of eight fields and ten seconds, as in `console_page`. First picture: from the click that chooses the
port to the frame that shows the link as up. Memory: of all of Chromium's processes, after a quarter of the time and at
its end, each time after the page and its worker have collected garbage. Without that it grows for minutes whatever the
page keeps: on a computer with much memory the browser lets garbage lie.
"""

from __future__ import annotations

import gzip
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright
from tests.page.wire import Wire
from tests.processes import below

import wirebond
from bench.console_page import FEEDER, FILL, LAYOUT, PROTOCOL, WATCH
from bench.figures import Figure
from wirebond.console.standalone import page_files

SECONDS = 60.0
NOISE_BYTES = 200_000  # a second: 2 Mbaud
COMMAND = "make bench ONLY=page_frames"
NOISE = """
import os, sys, time
from wirebond.sim.pty_port import PtyPort
port = PtyPort()
rate = int(sys.argv[3])
noise = [os.urandom(1 << 16) for _ in range(16)]
print(port.path, flush=True)
port.wait_for_program()
number, began = 0, time.monotonic()
while (now := time.monotonic()) - began < float(sys.argv[2]):
    due = int((now - began) * rate)
    while number < due:
        block, at = divmod(number, 1 << 16)
        piece = noise[block % 16][at : at + min(due - number, 1024)]
        port.write(piece)
        number += len(piece)
    port.read(0.001)
"""
FIRST = """() => {
  const look = (began) => {
    const state = document.querySelector("header .state")?.textContent ?? "";
    if (state.includes("Up")) globalThis.first = performance.now() - began;
    else requestAnimationFrame(() => look(began));
  };
  document.addEventListener("click", () => look(performance.now()), { capture: true, once: true });
}"""


@dataclass
class Seen:
    """The observations of one run of the page.

    :ivar first: milliseconds from the click to the first picture.
    :ivar frames: milliseconds between two frames.
    :ivar memory: bytes that the browser keeps, after a quarter of the time and at the end.
    """

    first: float
    frames: list[float]
    memory: tuple[int, int]


@contextmanager
def feeding(script: str, file: Path, seconds: float, rate: int) -> Iterator[str]:
    """The tty to which a process writes."""
    command = [sys.executable, "-c", script, str(file), str(seconds), str(rate)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.kill()


def look(script: str, rate: int, seconds: float, *, has_messages: bool) -> Seen:
    """Watch the page while this writes to its port."""
    with tempfile.TemporaryDirectory() as name:
        file, folder = Path(name) / "console_bench.yaml", Path(name) / "page"
        file.write_text(PROTOCOL)
        for path, data in page_files(wirebond.load(file)).items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_bytes(data)
        with feeding(script, file, seconds + FILL + 60, rate) as tty, Wire(folder).served() as wire:
            wire.device = tty
            return _watch(wire, seconds, has_messages=has_messages)


def _watch(wire: Wire, seconds: float, *, has_messages: bool) -> Seen:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path="/usr/bin/chromium", args=["--no-sandbox", "--js-flags=--expose-gc"]
        )
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        layout = json.dumps(json.dumps(LAYOUT))
        page.add_init_script(wire.script)
        page.add_init_script(f"localStorage.setItem('wirebond.layout.console_bench', {layout})")
        page.goto(f"http://127.0.0.1:{wire.port}/#/link")
        page.get_by_role("button", name="Choose a serial port").wait_for()
        first = _connect(page, has_messages=has_messages)
        page.locator("nav").get_by_text("Plots", exact=True).click()
        page.wait_for_timeout(FILL * 1000)
        page.evaluate(WATCH)
        page.wait_for_timeout(seconds * 250)
        early = kept_memory(page)
        page.wait_for_timeout(seconds * 750)
        frames, ages = page.evaluate("seen.frames")[1:], page.evaluate("seen.ages")
        late = kept_memory(page)
        browser.close()
    if has_messages and ages[-1][1] - ages[0][1] < 0.9 * seconds:
        raise RuntimeError(f"the plots stood still: {ages[0]} to {ages[-1]}")
    return Seen(first, frames, (early, late))


def _connect(page: Page, *, has_messages: bool) -> float:
    """Milliseconds until a message was received and shown; 0 if none comes."""
    page.evaluate(FIRST)
    page.get_by_role("button", name="Choose a serial port").click()
    page.get_by_role("button", name="Disconnect").wait_for()
    return float(page.wait_for_function("() => globalThis.first").json_value()) if has_messages else 0.0


def kept_memory(page: Page) -> int:
    """Collect garbage, and return the bytes that the browser then has."""
    for side in (page, *page.workers):
        side.evaluate("gc()")
    return memory_of_browser()


def memory_of_browser() -> int:
    """Bytes that the processes below this one have for themselves (PSS), Chromium's alone."""
    total = 0
    for process in below(os.getpid()):
        try:
            if "chrom" not in Path(f"/proc/{process}/comm").read_text():
                continue
            rollup = Path(f"/proc/{process}/smaps_rollup").read_text()
        except OSError:
            continue  # it has ended meanwhile
        total += 1024 * int(next(line.split()[1] for line in rollup.splitlines() if line.startswith("Pss:")))
    return total


def page_bytes() -> int:
    """Return the bytes that a browser loads from a web server that compresses."""
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "console_bench.yaml"
        file.write_text(PROTOCOL)
        files = page_files(wirebond.load(file))
    return sum(len(gzip.compress(data, 9)) for name, data in files.items() if name != "console_bench.html")


def measure() -> list[Figure]:
    """Both runs take two minutes and a half."""
    messages = look(FEEDER, 8000, SECONDS, has_messages=True)
    noise = look(NOISE, NOISE_BYTES, SECONDS, has_messages=False)
    early, late = noise.memory
    return [
        Figure("page_bytes", page_bytes() / 1000, "kB", 700, COMMAND),
        Figure("page_first_picture_ms", messages.first, "ms", 1000, COMMAND),
        Figure("page_frame_ms_p95", float(np.percentile(messages.frames, 95)), "ms", 20, COMMAND),
        Figure("page_noise_frame_ms_p95", float(np.percentile(noise.frames, 95)), "ms", 20, COMMAND),
        Figure("page_noise_memory_growth", late / early, "times", 1.1, COMMAND),
    ]
