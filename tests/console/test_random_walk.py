"""A page through which somebody walks at random, while links come and go, writes no error."""

from __future__ import annotations

import contextlib
import random
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Error, Page

from tests.console.browser import VIEWS, Robot, open_page, request_to
from tests.shared import PROTOCOLS
from tests.waiting import rounds_for
from wirebond.console import Console, Options

pytestmark = pytest.mark.live

SELECTIONS = ("", "?message=mcu:odometry", "?message=host:velocity", "?message=nothing", "?message=parameter")
SIZES = ((300, 200), (390, 844), (800, 500), (1280, 720), (1920, 1080))
FILES = [str(PROTOCOLS / f"{name}.yaml") for name in ("diffdrive", "linear_axis", "pid_tuner", "servo_bus")]


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_a_random_walk_finds_no_error_of_the_page(
    seed: int, browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    chance, problems = random.Random(seed), list[str]()
    robot = Robot(tmp_path)
    try:
        with Console(port=0, options=Options(may_connect=True)) as console:
            page = open_page(browser, console, problems=problems)
            steps: list[Callable[[], object]] = [
                *[lambda: _go(page, chance)] * 9,
                *[lambda: _click(page, chance)] * 5,
                *[lambda: page.keyboard.press(chance.choice([*"1234567p?tl", "Escape", "Tab", "Enter"]))] * 2,
                lambda: _resize(page, chance),
                page.reload,
                lambda: _post(console, "disconnect", {"over": True}),
                *[lambda: _connect(console, robot, chance)] * 2,
            ]
            for _ in rounds_for(40):
                chance.choice(steps)()
                assert problems == []
    finally:
        robot.kill()


def _go(page: Page, chance: random.Random) -> None:
    page.evaluate("(to) => { location.hash = to; }", f"#/{chance.choice(VIEWS)}{chance.choice(SELECTIONS)}")


def _click(page: Page, chance: random.Random) -> None:
    found = page.locator("main button:visible, main [role=row]:visible, main [role=option]:visible").all()
    with contextlib.suppress(Error):  # what was there is gone, or covered
        chance.choice(found or [page.locator("main")]).click(timeout=300)


def _resize(page: Page, chance: random.Random) -> None:
    width, height = chance.choice(SIZES)
    page.set_viewport_size({"width": width, "height": height})


def _connect(console: Console, robot: Robot, chance: random.Random) -> None:
    _post(
        console,
        "connect",
        {"port": chance.choice([str(robot.port), "sim:"]), "protocol": chance.choice([None, *FILES]), "over": True},
    )


def _post(console: Console, what: str, body: dict[str, object]) -> None:
    request = request_to(console, f"api/{what}", body)
    with contextlib.suppress(urllib.error.HTTPError):  # a refusal is an answer
        urllib.request.urlopen(request).close()
