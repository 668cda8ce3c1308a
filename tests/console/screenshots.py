"""Pictures of the console for the README. With ``--all``: of every view in every size, theme and language, and of what
goes wrong, to look at.

``make screenshots`` runs it. The robot is the simulated rover of the tests; another tab drives while they are made.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import product
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright

from tests.console.browser import (
    VIEWS,
    Desk,
    chromium,
    desk,
    noisy_robot,
    open_page,
    undescribed_device,
    wait_until,
)
from tests.shared import ROOT
from wirebond.console import Console, Options

IMAGES = ROOT / "docs" / "images"
SIZES = {"1280x720": (1280, 720), "1920x1080": (1920, 1080), "390x844": (390, 844)}
LANGUAGES = {"en": "en-US", "zh": "zh-CN"}
SETTLE = 1500  # ms that a view has to fill
HISTORY = 9000  # ms of driving before the first picture


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--all", metavar="FOLDER", type=Path, help="every view in every size, theme and language")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright, chromium(playwright) as browser:
        with desk(Path(folder), browser) as made:
            driver = drive(made)
            if options.all is None:
                for_readme(made, IMAGES)
            else:
                every_view(made, options.all)
            driver.keyboard.up("ArrowUp")
            driver.context.close()
            if options.all is not None:
                recorded_and_stopped(made, options.all)
        if options.all is not None:
            with without_port() as console:
                every_size(browser, console, ("link", "messages", "protocol"), options.all, "no-port")
            with noisy_robot() as console:
                every_size(browser, console, ("link", "messages"), options.all, "noise")
            with undescribed_device() as console:
                every_size(browser, console, ("link", "messages", "protocol"), options.all, "device")


def drive(made: Desk) -> Page:
    """A tab that is in control and drives a little, so that there is something to see."""
    page = made.page("control")
    page.locator("header").get_by_role("button", name="Take").click()
    page.get_by_role("form", name="status_query").get_by_role("button", name="Repeat").click()
    page.get_by_role("application").focus()
    for arrow in ("ArrowUp", "ArrowLeft", "ArrowUp"):
        page.keyboard.down(arrow)
        page.wait_for_timeout(HISTORY / 4)
        if arrow == "ArrowLeft":
            page.keyboard.up(arrow)
    return page


def for_readme(made: Desk, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    page = made.page("messages?message=mcu:odometry")
    page.locator(".detail .bytes").wait_for()
    take(page, folder / "console-messages.png")
    driver = made.browser.contexts[0].pages[0]
    driver.screenshot(path=folder / "console-control.png")


def every_view(made: Desk, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for view, (size, box), theme, (language, locale) in product(
        VIEWS, SIZES.items(), ("light", "dark"), LANGUAGES.items()
    ):
        viewport = {"width": box[0], "height": box[1]}
        page = made.page(view, viewport=viewport, color_scheme=theme, locale=locale)
        take(page, folder / f"{view}-{size}-{theme}-{language}.png")


def recorded_and_stopped(made: Desk, folder: Path) -> None:
    """A recording that is open, the emergency stop latched, and a cable that was pulled."""
    recordings = made.server.recordings
    recordings.start()
    page = made.page("plots")
    page.wait_for_timeout(HISTORY / 2)
    recordings.mark("something happened")
    page.wait_for_timeout(SETTLE)
    page.context.close()
    name = recordings.stop().name
    wait_until(lambda: not recordings.is_closing, "the recording is compressed")
    for view in VIEWS:
        every_size(made.browser, made.console, (f"{view}?recording={name}",), folder, "recording")
    made.link.emergency_stop()
    every_size(made.browser, made.console, ("control", "messages"), folder, "stopped")
    made.link.release_stop()
    made.robot.kill()
    wait_until(lambda: made.link.state == "down", "the link is down")
    every_size(made.browser, made.console, ("link", "messages", "plots", "control"), folder, "down")


def every_size(browser: Browser, console: Console, views: tuple[str, ...], folder: Path, what: str) -> None:
    """Small and light in English, large and dark in Chinese, and a phone."""
    for view, (size, box) in product(views, SIZES.items()):
        theme, language = ("dark", "zh") if size == "1920x1080" else ("light", "en")
        page = open_page(
            browser,
            console,
            view,
            viewport={"width": box[0], "height": box[1]},
            color_scheme=theme,
            locale=LANGUAGES[language],
        )
        take(page, folder / f"{what}-{view.split('?')[0]}-{size}.png")


@contextmanager
def without_port() -> Iterator[Console]:
    with Console(port=0, options=Options(may_connect=True)) as console:
        yield console


def take(page: Page, path: Path) -> None:
    page.wait_for_timeout(SETTLE)
    page.screenshot(path=path)
    page.context.close()


if __name__ == "__main__":
    main()
