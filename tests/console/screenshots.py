"""Pictures of the console for the README; with ``--all`` of every view in every size, theme and language, to look at.

``make screenshots`` runs it. The robot is the simulated rover of the tests; another tab drives while they are made.
"""

from __future__ import annotations

import argparse
import tempfile
from itertools import product
from pathlib import Path

from playwright.sync_api import Page

from tests.console.browser import VIEWS, Desk, chromium, desk
from tests.shared import ROOT

IMAGES = ROOT / "docs" / "images"
SIZES = {"1280x720": (1280, 720), "1920x1080": (1920, 1080), "390x844": (390, 844)}
LANGUAGES = {"en": "en-US", "zh": "zh-CN"}
SETTLE = 1500  # ms that a view has to fill
HISTORY = 9000  # ms of driving before the first picture


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--all", metavar="FOLDER", type=Path, help="every view in every size, theme and language")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, chromium() as browser, desk(Path(folder), browser) as made:
        driver = drive(made)
        if options.all is None:
            for_readme(made, IMAGES)
        else:
            everything(made, options.all)
        driver.keyboard.up("ArrowUp")


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
    take(made, "messages?message=mcu:odometry", folder / "console-messages.png", color_scheme="light")
    driver = made.browser.contexts[0].pages[0]
    driver.screenshot(path=folder / "console-control.png")


def everything(made: Desk, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for view, (size, box), theme, (language, locale) in product(
        VIEWS, SIZES.items(), ("light", "dark"), LANGUAGES.items()
    ):
        take(
            made,
            view,
            folder / f"{view}-{size}-{theme}-{language}.png",
            viewport={"width": box[0], "height": box[1]},
            color_scheme=theme,
            locale=locale,
        )


def take(made: Desk, view: str, path: Path, **options: object) -> None:
    page = made.page(view, **options)
    page.wait_for_timeout(SETTLE)
    page.screenshot(path=path)
    page.context.close()


if __name__ == "__main__":
    main()
