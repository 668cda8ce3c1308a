"""Is the console's page smooth, current and quick to answer at 8 000 messages a second, in headless Chromium?

A process writes the messages to a pty; `wirebond serve --web` owns the other side; the page shows its table of messages
above two plots of eight fields and ten seconds. Interval of frames: between two calls of requestAnimationFrame. Age:
from the time at which the server read a sample to the frame that has it, at each frame. Input: from a key to the frame
that shows its effect, as the browser's event timing has it; below 16 ms it is not told, and counted as 16.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Page, sync_playwright

from bench.figures import Figure

SECONDS = 60.0
FILL = 11.0  # seconds before the measurement, in which the plots fill
KEYS = 30  # that are pressed while it runs
COMMAND = "make bench ONLY=console_page"
PROTOCOL = """wirebond: 1
protocol: console_bench
link: {baud: 4000000}
frame:
  - magic: 0xAA 0x55
  - id: u8
  - payload: 16
  - check: crc-16/ibm-sdlc
messages:
  state:
    id: 1
    sender: mcu
    every: 125 us
    fields:
""" + "".join(f"      {name}: {{type: i16}}\n" for name in "abcdefgh")
FEEDER = """
import math, sys, time, wirebond
rate = int((sys.argv[3:] or [8000])[0])  # messages a second
from wirebond.sim.pty_port import PtyPort
port, codec = PtyPort(), wirebond.load(sys.argv[1])
values = lambda i: {n: round(9000 * math.sin(i / 600 + k)) for k, n in enumerate("abcdefgh")}
frames = [codec.encode("state", **values(i)) for i in range(3770)]
print(port.path, flush=True)
port.wait_for_program()
number, began = 0, time.monotonic()
while (now := time.monotonic()) - began < float(sys.argv[2]):
    due = int((now - began) * rate)
    if number < due:
        port.write(b"".join(frames[n % len(frames)] for n in range(number, due)))
        number = due
    port.read(0.001)
"""
FIELDS = [f"state.{name}" for name in "abcdefgh"]
LAYOUT = {
    "wirebond_layout": 1,
    "protocol": "console_bench",
    "seconds": 10,
    "table": True,
    "plots": [{"fields": FIELDS}, {"fields": FIELDS}],
}
WATCH = """() => {
  const seen = (globalThis.seen = { frames: [], ages: [], inputs: [] });
  new PerformanceObserver((list) => {
    for (const entry of list.getEntries()) if (entry.name.startsWith('key')) seen.inputs.push(entry.duration);
  }).observe({ type: 'event', durationThreshold: 16 });
  let last = performance.now();
  const step = (now) => {
    seen.frames.push(now - last);
    last = now;
    const plots = [...document.querySelectorAll('[data-newest]')];
    const newest = Math.max(...plots.map((one) => Number(one.dataset.newest)));
    seen.ages.push([(performance.timeOrigin + performance.now()) / 1000, newest]);
    requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}"""


def look() -> dict[str, Any]:
    """Return the page's measurements: intervals and ages of frames and the durations of inputs, all in milliseconds."""
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "console_bench.yaml"
        file.write_text(PROTOCOL)
        lasts = str(SECONDS + FILL + 60)
        with subprocess.Popen(
            [sys.executable, "-c", FEEDER, str(file), lasts], stdout=subprocess.PIPE, text=True
        ) as feeder:
            assert feeder.stdout is not None
            port = feeder.stdout.readline().strip()
            wirebond = str(Path(sys.executable).with_name("wirebond"))
            command = [wirebond, "serve", str(file), port, "--web", "127.0.0.1:0", "--no-browser"]
            with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as server:
                try:
                    return _watch(_address(server))
                finally:
                    server.terminate()
                    feeder.kill()


def _address(server: subprocess.Popen[str]) -> str:
    assert server.stderr is not None
    for line in server.stderr:
        if found := re.search(r"http://\S+", line):
            return found.group()
    raise RuntimeError("wirebond serve --web printed no address")


def _watch(address: str) -> dict[str, Any]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        layout = json.dumps(json.dumps(LAYOUT))
        page.add_init_script(f"localStorage.setItem('wirebond.layout.console_bench', {layout})")
        page.goto(address.replace("#", "#/plots?&"))
        page.wait_for_timeout(FILL * 1000)
        page.evaluate(WATCH)
        _press(page)
        seen = page.evaluate("seen")
        browser.close()
    behind = time.time() - time.monotonic()  # of the clocks of page and server
    ages = [(wall - behind - newest) * 1000 for wall, newest in seen["ages"] if newest is not None]
    return {"frames": seen["frames"][1:], "ages": ages, "inputs": seen["inputs"] or [16.0]}


def _press(page: Page) -> None:
    """The key that changes the language: every text of the page is drawn again."""
    for _ in range(KEYS):
        page.keyboard.press("l")
        page.wait_for_timeout(SECONDS * 1000 / KEYS)


def measure() -> list[Figure]:
    seen = look()
    return [
        Figure("console_frame_ms_p95", float(np.percentile(seen["frames"], 95)), "ms", 33, COMMAND),
        Figure("console_sample_age_ms", float(np.percentile(seen["ages"], 95)), "ms", 150, COMMAND),
        Figure("console_input_ms", float(max(seen["inputs"])), "ms", 100, COMMAND),
    ]
