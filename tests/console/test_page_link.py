"""The link in a browser: a noisy line, a cable that is pulled, and the choice of what to connect to."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

import wirebond
from tests.console.browser import Robot, noisy_robot, open_page, shows_the_robot, with_told
from tests.shared import PROTOCOLS, codec
from tests.waiting import wait_until
from wirebond.console import Console, Options
from wirebond.server import Server
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

DIFFDRIVE = PROTOCOLS / "diffdrive.yaml"


@pytest.fixture
def problems(browser: Browser) -> Iterator[list[str]]:
    """Collect the errors that pages write; there must be none."""
    found: list[str] = []
    yield found
    for context in browser.contexts:
        context.close()
    assert found == []


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    started = Robot(tmp_path)
    yield started
    started.kill()


def test_a_noisy_line_shows_what_was_discarded_and_why(browser: Browser, problems: list[str]) -> None:
    with noisy_robot() as console:
        page = open_page(browser, console, "link", problems)
        cause = page.get_by_role("row").filter(has_text="check_mismatch")
        frame = len(codec("diffdrive").encode("odometry", left_ticks=0, right_ticks=0))
        expect(cause).to_contain_text(re.compile(r"\d+ bytes"))
        assert int(re.findall(r"(\d+) bytes", cause.inner_text())[0]) % frame == 0
        expect(page.locator("header")).to_contain_text(re.compile(r"loss (?!0\.0 %)[\d.]+ %"))
        expect(page.get_by_text("incomplete", exact=True)).to_have_count(0)  # of the other causes there was none

        page.goto(page.url.replace("#/link", "#/messages"))
        page.get_by_role("button", name="odometry").click()
        expect(page.locator(".detail .summary").first).not_to_have_class(re.compile("bad"))
        page.get_by_role("button", name="with discarded bytes").click()
        page.get_by_role("option").filter(has_text="discarded").first.click()
        detail = page.locator(".detail")
        expect(detail.locator(".summary.bad")).to_contain_text("check")
        found = re.search(r"expected (\S+), found (\S+)", detail.get_by_role("listitem").first.inner_text())
        assert found is not None and found[1] != found[2]
        expect(detail.locator(".byte.wrong").first).to_be_visible()
        page.context.close()


def test_a_press_acts_on_what_was_under_the_finger_even_if_the_page_moves_meanwhile(
    browser: Browser, problems: list[str], tmp_path: Path
) -> None:
    pty, diffdrive = PtyPort(), codec("diffdrive")
    with (
        closing(pty),
        wirebond.open(diffdrive, pty.path) as link,
        Server(link, tmp_path / "server.sock") as server,
        Console(port=0) as console,
    ):
        console.show(link, server)
        page = open_page(browser, console, "messages", problems)
        notice = page.get_by_text("No message has come yet")
        expect(notice).to_be_visible()
        page.get_by_role("button", name="odometry").hover()
        page.mouse.down()
        pty.write(diffdrive.encode("odometry", left_ticks=1, right_ticks=2))
        expect(notice).not_to_be_visible()  # what was below it is where the notice was
        page.mouse.up()
        expect(page.get_by_role("region", name="odometry")).to_be_visible()

        page.get_by_role("button", name="parameter").hover()
        page.mouse.down()
        page.get_by_role("button", name="velocity").hover()  # the finger moved away: no press
        page.mouse.up()
        expect(page.get_by_role("region", name="odometry")).to_be_visible()
        page.get_by_role("button", name="velocity").click()
        expect(page.get_by_role("region", name="velocity")).to_be_visible()
        page.context.close()


def test_the_drift_of_the_clock_has_its_unit(browser: Browser, problems: list[str]) -> None:
    with noisy_robot() as console:
        page = open_page(browser, console, "link", problems)
        clock = {"offset": 1.5, "drift": -41.26, "error": 0.0002, "round_trip": 0.003, "exchanges": 9}
        with_told(page, "link", {"clock": clock})
        expect(page.locator(".latency")).to_contain_text("\u221241.3 ppm")
        page.context.close()


def test_a_cable_that_is_pulled_is_named_and_the_page_goes_on_when_it_is_back(
    browser: Browser, problems: list[str], robot: Robot, tmp_path: Path
) -> None:
    with (
        wirebond.open(codec("diffdrive"), str(robot.port)) as link,
        Server(link, tmp_path / "server.sock") as server,
        Console(port=0) as console,
    ):
        console.show(link, server)
        page = open_page(browser, console, "link", problems)
        shows_the_robot(page)
        robot.kill()
        expect(page.get_by_role("status")).to_contain_text("Down")
        expect(page.locator("main")).to_contain_text("is away")
        robot.start()
        shows_the_robot(page)
        expect(page.get_by_role("row").filter(has_text="reconnects")).to_contain_text("1")
        assert link.stats.reconnects == 1


def test_a_simulator_a_port_and_a_recording_are_chosen_in_the_page(
    browser: Browser, problems: list[str], robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    kept = tmp_path / "kept"
    with Console(port=0, options=Options(may_connect=True, recordings=kept)) as console:
        page = open_page(browser, console, "link", problems)
        expect(page.locator("main")).to_contain_text("Choose a port and a protocol file")
        page.get_by_role("button", name="Simulator of the chosen file").click()
        page.get_by_label("Protocol file").select_option(str(DIFFDRIVE.resolve()))
        page.get_by_role("button", name="Connect", exact=True).click()
        shows_the_robot(page)
        expect(page.locator("header")).to_contain_text("diffdrive")
        disconnect(page)

        connect(page, str(robot.port))
        shows_the_robot(page)
        expect(page.get_by_role("row").filter(has_text="▼ odometry")).to_contain_text("20.0 Hz")
        disconnect(page)

        path = kept / "run.mcap"
        with wirebond.open(codec("diffdrive"), str(robot.port)) as link, link.record(path):
            wait_until(lambda: link.stats.receive.messages.get("odometry", 0) > 5, "something to record")
        page.keyboard.press("6")  # without a port
        page.get_by_role("button", name="Open", exact=True).click()
        expect(page.locator(".legend .value").first).to_have_text(re.compile(r"\d"))
        page.keyboard.press("2")
        expect(page.locator("tr", has_text="odometry").first.locator(".fields")).to_contain_text("left_ticks")
        page.get_by_role("button", name="Back to live").click()

        page.keyboard.press("1")
        page.get_by_label("Recording", exact=True).select_option(str(path))
        page.get_by_role("button", name="Connect", exact=True).click()
        expect(page.locator("header .name")).to_have_text("diffdrive")  # the recording says so
        expect(page.get_by_role("row").filter(has_text="▼ odometry")).to_be_visible()
        expect(page.get_by_role("status")).to_contain_text("Down")  # it has ended
        expect(page.locator("main")).to_contain_text("has ended")


def connect(page: Page, port: str) -> None:
    page.get_by_label("Port", exact=True).fill(port)
    page.get_by_role("button", name="Connect", exact=True).click()
    expect(page.locator("header")).to_contain_text(port)


def disconnect(page: Page) -> None:
    with page.expect_response("**/api/disconnect"):  # it is answered when the port is closed
        page.get_by_role("button", name="Disconnect").click()
    expect(page.locator("main")).to_contain_text("Choose a port and a protocol file")
