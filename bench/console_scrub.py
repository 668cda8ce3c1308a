"""Does an hour of 1 kHz history of eight fields move under the hand, in headless Chromium, and are its peaks kept?

The hour lies in the server's history as if it had just come. Two plots of four fields show all of it; then the pointer
drags it to and fro, at the scale of an hour, of minutes and of seconds. Pause: between two pictures that have another
range, while the pointer moves. One sample in the hour is a peak: the picture of the whole hour must have it.
"""

from __future__ import annotations

import csv
import json
import math
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Browser, Page, sync_playwright

import wirebond
from bench.console_page import PROTOCOL
from bench.figures import Figure
from wirebond.console import Console
from wirebond.protocol.model import End
from wirebond.server import Server
from wirebond.sim.pty_port import PtyPort

HOUR = 3600.0
RATE = 1000  # messages a second
PEAK = 32_000
MOVES = 60  # of the pointer at each scale
SPANS = (HOUR, 300.0, 10.0)  # seconds that are shown while it is dragged
COMMAND = "make bench ONLY=console_scrub"
_PIECE = 100_000  # frames that are fed at once
_LAYOUT = {
    "wirebond_layout": 1,
    "protocol": "console_bench",
    "seconds": 3600,
    "plots": [{"fields": [f"state.{name}" for name in names]} for names in ("abcd", "efgh")],
}
_WATCH = """() => {
  const seen = (globalThis.seen = []);
  let last = '';
  const step = (now) => {
    const drawn = [...document.querySelectorAll('[data-from]')].map((plot) => plot.dataset.from).join(' ');
    if (drawn !== last) seen.push(now);
    last = drawn;
    requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}"""


def fill(console: Console, codec: wirebond.Codec, seconds: float) -> float:
    """The history of so long up to now, with one peak. Returns when it began."""
    served = console.station.served
    assert served is not None
    count = int(seconds * RATE)
    names = "abcdefgh"
    frames = [
        codec.encode("state", **{n: round(9000 * math.sin(i / 600 + k)) for k, n in enumerate(names)})
        for i in range(3770)
    ]
    peak = codec.encode("state", **dict.fromkeys(names, PEAK))
    begin = time.monotonic() - seconds
    for first in range(0, count, _PIECE):
        numbers = range(first, min(first + _PIECE, count))
        chunks = [peak if number == count // 3 else frames[number % len(frames)] for number in numbers]
        served.source.feed(End.MCU, chunks, [begin + number / RATE for number in numbers])
    return begin


def look(browser: Browser, seconds: float = HOUR, moves: int = MOVES) -> dict[str, Any]:
    """The pauses in milliseconds, and the greatest value in the picture of all."""
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "console_bench.yaml"
        file.write_text(PROTOCOL.replace("every: 125 us", "every: 1 ms"))
        codec, pty = wirebond.load(file), PtyPort()
        with (
            wirebond.open(codec, pty.path) as link,
            Server(link, Path(name) / "server.sock") as server,
            Console(port=0) as console,
        ):
            console.show(link, server)
            begin = fill(console, codec, seconds)
            page = browser.new_page(viewport={"width": 1280, "height": 720})
            layout = json.dumps(json.dumps(_LAYOUT))
            page.add_init_script(f"localStorage.setItem('wirebond.layout.console_bench', {layout})")
            found = _scrub(page, console.address, begin, seconds, moves, Path(name))
            page.close()
        pty.close()
    return found


def _scrub(page: Page, address: str, begin: float, seconds: float, moves: int, folder: Path) -> dict[str, Any]:
    page.goto(f"{address}#/plots?from={begin:.4f}&to={begin + seconds:.4f}")
    page.wait_for_selector(f"[data-from='{begin:.4f}']")
    with page.expect_download() as download:
        page.get_by_role("button", name="CSV").click()
    path = folder / "shown.csv"
    download.value.save_as(path)
    with path.open() as lines:
        greatest = max(float(row["high"]) for row in csv.DictReader(lines))
    page.evaluate(_WATCH)
    pauses: list[float] = []
    for span in SPANS:
        middle = begin + seconds / 2
        page.evaluate(f"location.hash = '#/plots?from={middle - span / 2:.4f}&to={middle + span / 2:.4f}'")
        page.wait_for_selector(f"[data-from='{middle - span / 2:.4f}']")
        pauses += _drag(page, moves)
    return {"pauses": pauses, "greatest": greatest}


def _drag(page: Page, moves: int) -> list[float]:
    """Shift and the pointer, to and fro; what passed between two pictures."""
    over = page.locator(".u-over").first
    while (box := over.bounding_box()) is None:
        over.wait_for()  # a plot that changes its height is made again
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.keyboard.down("Shift")
    page.mouse.move(x, y)
    page.mouse.down()
    page.evaluate("seen.length = 0")
    for number in range(1, moves + 1):
        page.mouse.move(x + 0.4 * box["width"] * math.sin(number / moves * 2 * math.pi), y)
        page.wait_for_timeout(16)
    times = page.evaluate("seen")
    page.mouse.up()
    page.keyboard.up("Shift")
    return [float(pause) for pause in np.diff(times)]


def measure() -> list[Figure]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        found = look(browser)
        browser.close()
    if found["greatest"] != PEAK:
        raise RuntimeError(f"the peak of {PEAK} is lost: the greatest value shown is {found['greatest']}")
    return [Figure("console_scrub_ms", max(found["pauses"]), "ms", 100, COMMAND)]
