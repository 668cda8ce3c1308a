"""Does an hour of 1 kHz history of eight fields move under the hand, in headless Chromium, and are its peaks kept?

The hour lies in the server's history as if it had just come. Two plots of four fields show all of it; then the pointer
drags it to and fro, at the scale of an hour, of minutes and of seconds, and pulls it some screens in one direction.
Pause: between two pictures that have another range, while the pointer moves. Answer: from a movement of the pointer to
the picture in which all plots show its range or that of a later movement, with the lines of all of the range. A picture
counts when the frame after it begins. One sample in the hour is a peak: the picture of the whole hour must have it.
"""

from __future__ import annotations

import json
import math
import re
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Browser, Page, expect, sync_playwright

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
MOVES = 120  # of the pointer at each scale
SPANS = (HOUR, 300.0, 10.0)  # seconds that are shown while it is dragged
COMMAND = "make bench ONLY=console_scrub"
_PIECE = 100_000  # frames that are fed at once
_LAYOUT: dict[str, Any] = {
    "wirebond_layout": 1,
    "protocol": "console_bench",
    "seconds": 3600,
    "plots": [{"fields": [f"state.{name}" for name in names]} for names in ("abcd", "efgh")],
}
_DIGITS = re.compile(r"\d+")
_PICTURES = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
_TRIES = 20  # of a plot to stand still
PULLS = 4  # in one direction, each over most of a screen
_WATCH = """() => {
  const seen = (globalThis.seen = { moves: [], pictures: [] });
  const plots = () => [...document.querySelectorAll('[data-from]')];
  addEventListener('pointerdown', (event) => {
    const { dataset } = plots()[0];
    Object.assign(seen, { x: event.clientX, from: Number(dataset.from), moves: [], pictures: [] });
  }, true);
  addEventListener('pointermove', (event) => seen.moves.push([event.timeStamp, event.clientX]), true);
  let last = '';
  const step = (now) => {
    const drawn = plots().map(({ dataset }) => [Number(dataset.from), dataset.whole === 'true']);
    if (JSON.stringify(drawn) !== last) seen.pictures.push([now, drawn]);
    last = JSON.stringify(drawn);
    requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}"""
# Do all plots show where the pointer was last?
_SHOWN = """(secondsPerPixel) => {
  const wanted = seen.from + (seen.x - seen.moves.at(-1)[1]) * secondsPerPixel;
  const last = seen.pictures.at(-1)?.[1] ?? [];
  return last.length && last.every(([from, isWhole]) => isWhole && Math.abs(from - wanted) < secondsPerPixel / 2);
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
            found = _scrub(page, console.address, begin, seconds, moves)
            page.close()
        pty.close()
    return found


def _scrub(page: Page, address: str, begin: float, seconds: float, moves: int) -> dict[str, Any]:
    page.goto(address.replace("#", f"#/plots?from={begin:.4f}&to={begin + seconds:.4f}&"))
    _wait_for(page, begin)
    share = (int(seconds * RATE) // 3) / (seconds * RATE)
    greatest = _greatest(page, share)
    page.evaluate(_WATCH)
    found: dict[str, Any] = {"pauses": [], "answers": [], "greatest": greatest}
    to_and_fro = [0.4 * math.sin(number / moves * 2 * math.pi) for number in range(1, moves + 1)]
    pull = [-0.8 * number / (moves // 3) for number in range(1, moves // 3 + 1)]
    for span in SPANS:
        middle = begin + seconds / 2
        page.evaluate(f"location.hash = '#/plots?from={middle - span / 2:.4f}&to={middle + span / 2:.4f}'")
        _wait_for(page, middle - span / 2)
        drags = [(0.5, to_and_fro), *([(0.9, pull)] * PULLS if span < seconds else [])]
        for at, path in drags:
            seen, seconds_per_pixel = _drag(page, at, path, span)
            found["pauses"] += np.diff([t for t, _ in seen["pictures"]]).tolist()
            found["answers"] += answers(seen, seconds_per_pixel)
    return found


def _wait_for(page: Page, begin: float) -> None:
    """Until both plots show all of the range that begins so."""
    expect(page.locator(f"[data-from='{begin:.4f}'][data-whole=true]")).to_have_count(len(_LAYOUT["plots"]))


def _greatest(page: Page, share: float) -> float:
    """Return the maximum in the legends at ``share``, in widths of a plot: the largest value in the rows of each
    line."""
    position = page.locator(".position")
    for _ in range(_TRIES):
        box = _at_rest(page)
        found = []
        for beside in (-1, 0, 1, 2):  # pixels: rows and pixels need not begin together
            before = position.inner_text()
            page.mouse.move(box["x"] + share * box["width"] + beside, box["y"] + box["height"] / 2)
            expect(position).not_to_have_text(before)
            texts = page.locator(".legend .value").all_inner_texts()
            numbers = [_DIGITS.findall("".join(text.split())) for text in texts]
            found.append(min(max(map(float, each), default=-math.inf) for each in numbers))
        page.mouse.move(0, 0)
        if _at_rest(page) == box:  # else the pointer was somewhere else
            return max(found)
    raise RuntimeError("the first plot does not stay where it is")


def _at_rest(page: Page) -> Any:
    """Return the place of the first plot once it no longer moves: two pictures in a row agree, with room for the
    numbers of its axes."""
    over = page.locator(".u-over").first
    before = over.bounding_box()
    for _ in range(_TRIES):
        page.evaluate(_PICTURES)
        now = over.bounding_box()
        if now is not None and now == before:
            return now
        before = now
    raise RuntimeError(f"the first plot does not stand still: it was at {before}")


def _drag(page: Page, at: float, path: list[float], span: float) -> tuple[dict[str, Any], float]:
    """Shift and the pointer, from one place along a path, in widths of the plot: what the page saw, until the last
    movement was shown; and how many seconds a pixel is."""
    over = page.locator(".u-over").first
    while (box := over.bounding_box()) is None:
        over.wait_for()  # a plot that changes its height is made again
    width, y = box["width"], box["y"] + box["height"] / 2
    x = box["x"] + at * width
    page.keyboard.down("Shift")
    page.mouse.move(x, y)
    page.mouse.down()
    for share in path:
        page.mouse.move(x + share * width, y)  # returns when the page has heard of it
    page.wait_for_function(_SHOWN, arg=span / width)
    seen = page.evaluate("seen")
    page.mouse.up()
    page.keyboard.up("Shift")
    return seen, span / width


def answers(seen: dict[str, Any], seconds_per_pixel: float) -> list[float]:
    """Return the milliseconds from each movement to the picture that shows it."""
    moves = [(t, seen["from"] + (seen["x"] - x) * seconds_per_pixel) for t, x in seen["moves"]]
    found = []
    for number, (moved, _) in enumerate(moves):
        for t, plots in seen["pictures"]:
            later = [begin for when, begin in moves[number:] if when <= t]
            if any(
                all(is_whole and abs(begin - wanted) < 0.5 * seconds_per_pixel for begin, is_whole in plots)
                for wanted in later
            ):
                found.append(t - moved)
                break
        else:
            raise RuntimeError(f"movement {number} of {len(moves)} was never shown")
    return found


def measure() -> list[Figure]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        found = look(browser)
        browser.close()
    if found["greatest"] != PEAK:
        raise RuntimeError(f"the peak of {PEAK} is lost: the greatest value shown is {found['greatest']}")
    return [
        Figure("console_scrub_ms", max(found["pauses"]), "ms", 100, COMMAND),
        Figure("console_scrub_answer_ms", max(found["answers"]), "ms", 100, COMMAND),
    ]
