"""A simulated robot on a real pty, the server that owns its line, and a browser that shows the console's page."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

import wirebond
from tests.shared import PROTOCOLS, ROOT
from wirebond.console import Console
from wirebond.server import Server

CHROMIUM = Path("/usr/bin/chromium")
AXE = ROOT / "console" / "node_modules" / "axe-core" / "axe.min.js"
PAGE = ROOT / "python" / "src" / "wirebond" / "console" / "page" / "index.html"
PATIENCE = 15.0  # seconds: a bound for slow machines, not an expectation
VIEWS = ("link", "messages", "plots", "control", "tuning", "recordings", "protocol")

# The robot says when each velocity came, on a clock that all processes of this computer share.
_BEHAVIOUR = """
import time

def setup(mcu):
    @mcu.on("velocity")
    def velocity(message):
        mcu.report(f"got {time.monotonic()} {message['linear']} {message['angular']}")

    @mcu.on("status_query")
    def status(message):
        return {"battery": 11.97, "errors": ["encoder"], "state": []}
"""


@dataclass
class Velocity:
    """One that the robot got."""

    t: float
    linear: float
    angular: float


class Robot:
    """A virtual MCU in a process of its own. ``start`` again after ``kill`` is the cable that comes back."""

    def __init__(self, folder: Path, protocol: str = "diffdrive") -> None:
        self.port = folder / "robot"
        self.velocities: list[Velocity] = []
        self._script = folder / "behaviour.py"
        self._script.write_text(_BEHAVIOUR)
        self._protocol = protocol
        self.start()

    def start(self) -> None:
        script = ["--script", str(self._script)] if self._protocol == "diffdrive" else []
        file = PROTOCOLS / f"{self._protocol}.yaml"
        wirebond = str(Path(sys.executable).with_name("wirebond"))
        command = [wirebond, "sim", str(file), "--link", str(self.port), *script]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        wait_until(self.port.exists, "the robot's port")
        threading.Thread(target=self._listen, args=(self._process,), daemon=True).start()

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()
        self.port.unlink(missing_ok=True)

    def _listen(self, process: subprocess.Popen[str]) -> None:
        assert process.stderr is not None
        for line in process.stderr:
            if found := re.search(r"got (\S+) (\S+) (\S+)", line):
                self.velocities.append(Velocity(*map(float, found.groups())))

    def wait_for(self, fits: Callable[[Velocity], object], since: float) -> Velocity:
        """The first velocity behind ``since`` that fits."""
        found: list[Velocity] = []

        def came() -> bool:
            found[:] = [v for v in self.velocities if v.t > since and fits(v)]
            return bool(found)

        wait_until(came, "a velocity at the robot")
        return found[0]


@dataclass
class Desk:
    """All that a test needs."""

    robot: Robot
    link: wirebond.Link
    server: Server
    console: Console
    browser: Browser
    problems: list[str] = field(default_factory=list)  # what pages wrote as errors

    def page(self, view: str = "link", **options: Any) -> Page:
        """A tab of a browser's profile of its own."""
        context = self.browser.new_context(
            **{"viewport": {"width": 1280, "height": 720}, "locale": "en-US", "color_scheme": "light", **options}
        )
        context.set_default_timeout(PATIENCE * 1000)
        page = context.new_page()
        page.on("pageerror", lambda error: self.problems.append(error.stack or str(error)))
        page.goto(f"{self.console.address.split('#')[0]}#/{view}")
        return page


@contextmanager
def desk(folder: Path, browser: Browser, protocol: str = "diffdrive", **options: Any) -> Iterator[Desk]:
    robot = Robot(folder, protocol)
    codec = wirebond.load(PROTOCOLS / f"{protocol}.yaml")
    try:
        with (
            wirebond.open(codec, str(robot.port)) as link,
            Server(link, folder / "server.sock", recordings=folder / "recordings") as server,
            Console(port=0, **options) as console,
        ):
            console.show(link, server)
            yield Desk(robot, link, server, console, browser)
    finally:
        robot.kill()


@contextmanager
def chromium() -> Iterator[Browser]:
    if not PAGE.exists():
        pytest.skip("the page is not built: that needs Node, as setup/page.sh says")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        yield browser
        browser.close()


def wait_until(holds: Callable[[], object], what: str) -> None:
    end = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < end, what
        time.sleep(0.005)


def serious(page: Page) -> list[str]:
    """What axe finds that is serious or worse, each as one line."""
    page.evaluate(AXE.read_text())
    found = page.evaluate("axe.run(document, {resultTypes: ['violations']}).then((result) => result.violations)")
    return [
        f"{one['id']}: {node['target']} {node['failureSummary']}"
        for one in found
        if one["impact"] in ("serious", "critical")
        for node in one["nodes"]
    ]
