"""Whatever becomes of a page that drives, the robot stops: in Chromium, by times of the simulated robot."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, Playwright, expect

from tests.console.browser import CHROMIUM, Desk, address_of, chromium, desk
from tests.relay import Relay
from tests.waiting import let_pass, wait_until
from wirebond.link.attached.words import OLDEST_COMMAND
from wirebond.server.control import ControlBook

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("real_ages")]
BOUND = 0.35  # seconds from the last heartbeat that the server heard to zero velocity at the robot
WORD = f"--user-agent-product={time.monotonic_ns()}"  # names this file's Chromium in the list of processes


@pytest.fixture(scope="module")
def browser(playwright: Playwright) -> Iterator[Browser]:
    with chromium(playwright, WORD) as started:
        yield started


@pytest.fixture(scope="module")
def shared_desk(tmp_path_factory: pytest.TempPathFactory, browser: Browser) -> Iterator[Desk]:
    with desk(tmp_path_factory.mktemp("desk"), browser) as made:
        yield made


@pytest.fixture
def rover(shared_desk: Desk) -> Iterator[Desk]:
    with shared_desk.of_one_test() as one:
        yield one


@pytest.fixture
def beats(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return the times at which the server received each heartbeat that counts."""
    heard: list[float] = []
    beat = ControlBook.beat

    def spied(book: ControlBook, client: object, tick: int, now: float) -> None:
        if book.ticks.age(tick, now) <= OLDEST_COMMAND:
            heard.append(now)
        beat(book, client, tick, now)

    monkeypatch.setattr(ControlBook, "beat", spied)
    return heard


def ends_within_the_bound(rover: Desk, page: Page, beats: list[float], end: Callable[[], None]) -> None:
    """``end`` takes away the page that drives."""
    while True:
        rover.drive(page)
        beats.clear()
        wait_until(lambda: beats or rover.server.holder is None, "a heartbeat")
        if rover.server.holder is not None:
            break
    ending = time.monotonic()
    end()
    wait_until(lambda: rover.server.holder is None, "control ends")
    rover.robot.wait_for(lambda v: v.linear == 0, ending)
    last = beats[-1]
    stopped = next(v.t for v in rover.robot.velocities if v.t > last and v.linear == 0)
    assert stopped - last <= BOUND
    let_pass(0.2)  # the lease of a command would still be in force
    assert all(v.linear == 0 for v in rover.robot.velocities if v.t >= stopped)


def hangs(rover: Desk, beats: list[float]) -> None:
    """All processes of the browser are stopped, as by a laptop that is shut: no heartbeat, and no end."""
    page = rover.page("control")
    try:
        ends_within_the_bound(rover, page, beats, lambda: signal_all(WORD, signal.SIGSTOP))
    finally:
        signal_all(WORD, signal.SIGCONT)
    expect(page.get_by_text("You are in control")).not_to_be_visible()
    came = time.monotonic()
    page.keyboard.up("ArrowUp")
    page.keyboard.down("ArrowUp")  # it does not drive on
    page.keyboard.up("ArrowUp")
    assert all(v.linear == 0 for v in rover.robot.since(came))
    page.context.close()


def loses_its_packets(rover: Desk, beats: list[float]) -> None:
    """They are dropped without a close: the connection stays, and nothing comes through it."""
    port = rover.console.port  # the server refuses another one
    with Relay(port, "127.0.0.2", port) as relay:
        page = rover.page("control", f"http://127.0.0.2:{port}/")
        ends_within_the_bound(rover, page, beats, relay.drops.set)
        page.context.close()


def is_killed(rover: Desk, beats: list[float]) -> None:
    word = f"--user-agent-product={time.monotonic_ns()}"
    launch = rover.browser.browser_type.launch
    page = launch(executable_path=str(CHROMIUM), args=["--no-sandbox", word]).new_page()
    page.goto(address_of(rover.console, "control"))
    ends_within_the_bound(rover, page, beats, lambda: signal_all(word, signal.SIGKILL))


@pytest.mark.timed(tolerance=0.1)
@pytest.mark.parametrize("end", [hangs, loses_its_packets])
def test_a_page_that_is_silent_stops_the_robot_within_350_ms(
    rover: Desk, beats: list[float], end: Callable[[Desk, list[float]], None]
) -> None:
    end(rover, beats)


@pytest.mark.long
@pytest.mark.timed(tolerance=0.1)
@pytest.mark.parametrize("end", [hangs, loses_its_packets, is_killed])
def test_a_page_that_is_gone_stops_the_robot_within_350_ms_each_time(
    rover: Desk, beats: list[float], end: Callable[[Desk, list[float]], None]
) -> None:
    for _ in range(10):
        end(rover, beats)


def signal_all(word: str, number: signal.Signals) -> None:
    """To all processes of the Chromium that this word names."""
    for pid in processes(word):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)


def processes(word: str) -> set[int]:
    """Those whose command line has this word, and their descendants."""
    parents: dict[int, int] = {}
    found: set[int] = set()
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            parents[int(folder.name)] = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            if word.encode() in (folder / "cmdline").read_bytes():
                found.add(int(folder.name))
    while more := {pid for pid, parent in parents.items() if parent in found} - found:
        found |= more
    return found
