"""A page without a server in Chromium, its port joined to a simulated robot."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, Playwright, Worker, expect, sync_playwright
from playwright.sync_api import Error as BrowserError

from tests.console import browser as browsers
from tests.console.browser import Robot, Velocity
from tests.page.wire import Wire
from tests.shared import PROTOCOLS, ROOT, codec
from tests.waiting import PATIENCE, moments, rounds_for
from wirebond import paths
from wirebond.console.standalone import page_files

PICTURES = ROOT / "build" / "screenshots"
# A page and its worker give control up, and refuse commands, by times of a second or less. With this a second is four.
PATIENT = """
{
  const now = performance.now.bind(performance);
  const wall = Date.now.bind(Date);
  const [began, day] = [now(), wall()];
  performance.now = () => began + (now() - began) / 4;
  Date.now = () => day + (now() - began) / 4;
}
"""


def write_page(folder: Path, protocol: str) -> Path:
    """The page of a protocol, as `wirebond gen --lang page` writes it."""
    for name, data in page_files(codec(protocol)).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return folder


@dataclass
class Seat:
    """A browser with a page, and the wire to what is at its port."""

    wire: Wire
    browser: Browser
    problems: list[str] = field(default_factory=list)  # what pages wrote as errors

    def open(self, view: str = "link", *, is_patient: bool = True, **options: Any) -> Page:
        context = self.browser.new_context(
            **{"viewport": {"width": 1280, "height": 720}, "locale": "en-US", "color_scheme": "light", **options}
        )
        context.set_default_timeout(PATIENCE * 1000)
        self.wire.before = PATIENT if is_patient else ""
        context.add_init_script(self.wire.script)
        page = context.new_page()
        page.on("pageerror", lambda error: self.problems.append(error.stack or str(error)))
        page.goto(f"http://127.0.0.1:{self.wire.port}/#/{view}")
        return page

    def connected(self, view: str = "link", **options: Any) -> Page:
        """A page whose person has chosen the port, and that shows this view."""
        page = self.open("link", **options)
        page.get_by_role("button", name="Choose a serial port").click()
        expect(page.get_by_role("button", name="Disconnect")).to_be_visible()
        if view != "link":
            page.locator("nav").get_by_text(view.capitalize(), exact=True).click()
        return page


def worker_of(page: Page) -> Worker:
    (worker,) = page.workers
    return worker


@pytest.fixture(scope="package")
def playwright() -> Iterator[Playwright]:
    if not browsers.PAGE.exists() or not paths.ENGINE_FOR_PAGES.exists():
        pytest.skip("the page is not built: that needs Node, as setup/page.sh says")
    with sync_playwright() as started:
        yield started


@pytest.fixture(scope="package")
def browser(playwright: Playwright) -> Iterator[Browser]:
    with browsers.chromium(playwright) as started:
        yield started


@contextmanager
def seat_of(folder: Path, browser: Browser) -> Iterator[Seat]:
    with Wire(folder).served() as wire:
        made = Seat(wire, browser)
        yield made
        browsers.close_tabs(browser)
        assert made.problems == []


@dataclass
class Rover:
    """A page that can drive a simulated rover."""

    seat: Seat
    robot: Robot

    def drive(self, page: Page) -> Velocity:
        """Hold the key until the robot moves: its first velocity."""
        control = page.get_by_text("You are in control")
        for _ in moments("the robot moves"):
            if not control.is_visible():
                page.locator("header").get_by_role("button", name="Take control").click()
                expect(control).to_be_visible()
            page.get_by_role("application").focus()
            page.keyboard.up("ArrowUp")
            since = time.monotonic()
            page.keyboard.down("ArrowUp")
            for _ in rounds_for(2):
                if moving := [velocity for velocity in self.robot.since(since) if velocity.linear > 0]:
                    return moving[0]
        raise AssertionError


@pytest.fixture(scope="package")
def diffdrive_page(tmp_path_factory: pytest.TempPathFactory, browser: Browser) -> Path:
    return write_page(tmp_path_factory.mktemp("page"), "diffdrive")


@pytest.fixture
def rover(diffdrive_page: Path, tmp_path: Path, browser: Browser) -> Iterator[Rover]:
    robot = Robot(tmp_path)
    with seat_of(diffdrive_page, browser) as seat:
        seat.wire.device = str(robot.port)
        yield Rover(seat, robot)
    robot.kill()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_teardown(item: pytest.Function) -> None:
    """Keep the last picture of each browser when its test ends."""
    started = item.funcargs.get("browser")
    pages = [] if started is None else [page for context in started.contexts for page in context.pages]
    for number, page in enumerate(pages):
        with contextlib.suppress(BrowserError):
            page.screenshot(path=PICTURES / f"{item.path.stem}-{item.name}-{number}.png", timeout=2000)


def in_control(page: Page) -> Locator:
    return page.get_by_text("You are in control")


DIFFDRIVE = PROTOCOLS / "diffdrive.yaml"
