"""A page whose network is dead says so, stops the robot as soon as it can, and drives nothing by itself."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.console.browser import VIEWS, Desk, desk, serious, shows_the_robot, take_control
from tests.relay import Relay
from tests.waiting import moments, wait_until
from wirebond.chinese import chinese

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("real_ages")]
UNCONFIRMED = "STOP sent, not confirmed, trying again"


@pytest.fixture(scope="module")
def shared_desk(tmp_path_factory: pytest.TempPathFactory, browser: Browser) -> Iterator[Desk]:
    with desk(tmp_path_factory.mktemp("desk"), browser) as made:
        yield made


@pytest.fixture
def rover(shared_desk: Desk) -> Iterator[Desk]:
    with shared_desk.of_one_test() as one:
        yield one


@contextmanager
def behind_a_network(rover: Desk, view: str) -> Iterator[tuple[Page, Relay]]:
    """A page whose packets can be dropped without a close."""
    port = rover.console.port  # the server refuses another one
    with Relay(port, "127.0.0.2", port) as relay:
        page = rover.page(view, f"http://127.0.0.2:{port}/")
        shows_the_robot(page)
        # Both connections are up.
        expect(page.locator("header").get_by_role("button", name="Take control")).to_be_enabled()
        yield page, relay
        page.context.close()


def test_a_page_on_a_dead_network_says_so_and_its_stop_arrives_when_the_network_is_back(rover: Desk) -> None:
    with behind_a_network(rover, "control") as (page, relay):
        take_control(page)
        relay.drops.set()
        status, stop = page.get_by_role("status").first, page.locator("header button.stop")
        expect(status).to_contain_text("this page has received nothing for")
        expect(page.get_by_text("You are in control")).to_have_count(0)
        expect(page.locator("header")).to_contain_text("This page is not in control")
        expect(stop).to_contain_text("server not reached")
        first = float(re.findall(r"nothing for ([\d.]+)", status.inner_text())[0])
        wait_until(lambda: float(re.findall(r"nothing for ([\d.]+)", status.inner_text())[0]) > first, "it counts")

        page.keyboard.press(" ")
        unconfirmed = page.get_by_role("alert").filter(has_text=re.compile("STOP (sent, not confirmed|not sent yet)"))
        expect(unconfirmed).to_contain_text("The server cannot be reached")
        assert not rover.link.stopped
        expect(unconfirmed.get_by_role("button", name="Give up")).to_be_visible()
        expect(page.locator("header .port")).to_have_count(0)  # the connection is given up, and another one is tried
        expect(page.locator("header .name")).to_have_text("diffdrive")

        relay.drops.clear()
        expect(page.get_by_role("alert").filter(has_text="Emergency stop")).to_be_visible()
        expect(unconfirmed).to_have_count(0)
        assert rover.link.stopped
        shows_the_robot(page)
        assert rover.server.holder is None
        rover.link.release_stop()
        expect(page.locator("header")).to_contain_text("No program is in control")
        expect(page.get_by_role("application")).to_contain_text("Take control first")


def test_the_last_values_stay_legible(rover: Desk) -> None:
    with behind_a_network(rover, "link") as (page, relay):
        relay.drops.set()
        for number, view in enumerate(VIEWS, start=1):
            page.keyboard.press(str(number))
            expect(page.locator("main.past")).to_be_visible()
            assert f"#/{view}" in page.url
            assert serious(page) == [], view


def test_a_stop_into_a_silent_connection_is_not_called_done(rover: Desk) -> None:
    with behind_a_network(rover, "link") as (page, relay):
        said = page.get_by_role("alert")
        for _ in moments("a stop into a connection that seems to live"):
            relay.drops.set()
            page.keyboard.press(" ")
            expect(said).to_contain_text(re.compile("STOP (sent, not confirmed|not sent yet), trying again"))
            if UNCONFIRMED in said.inner_text():
                break
            # The machine was busy: the key came when the page had received nothing for a second, and knew it.
            page.get_by_role("button", name="Give up").click()
            relay.drops.clear()
            shows_the_robot(page)
        expect(said).to_contain_text(UNCONFIRMED)
        expect(page.locator("header button.stop")).to_contain_text("STOP")
        page.get_by_role("button", name="Give up").click()
        expect(page.get_by_role("alert")).to_have_count(0)


@pytest.mark.parametrize(
    ("view", "element"),
    [
        ("control", "input[type=number]"),
        ("control", "form button"),
        ("control", ".pad"),
        ("link", "select"),
        ("link", "nav button"),
    ],
)
def test_space_stops_wherever_the_focus_is(rover: Desk, view: str, element: str) -> None:
    page = rover.page(view)
    shows_the_robot(page)
    page.locator(element).first.focus()
    page.keyboard.press(" ")
    expect(page.get_by_role("alert").filter(has_text="Emergency stop")).to_be_visible()
    assert rover.link.stopped


def test_where_text_is_written_space_is_a_blank_and_shift_and_space_stop(rover: Desk) -> None:
    page = rover.page("messages")
    shows_the_robot(page)
    field = page.locator("#filter")
    field.focus()
    page.keyboard.type("a b")
    expect(field).to_have_value("a b")
    assert not rover.link.stopped
    page.keyboard.press("Shift+ ")
    expect(page.get_by_role("alert").filter(has_text="Emergency stop")).to_be_visible()
    expect(field).to_have_value("a b")
    rover.link.release_stop()
    expect(page.get_by_role("alert")).to_have_count(0)
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("?")
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("Emergency stop where text is written")
    dialog.get_by_role("button", name="STOP").click()  # the dialog covers the page's own
    wait_until(lambda: rover.link.stopped, "the stop")


def test_a_stop_says_that_the_robot_cannot_be_reached(rover: Desk) -> None:
    page = rover.page("link")
    shows_the_robot(page)
    rover.robot.kill()
    try:
        expect(page.get_by_role("status").first).to_contain_text("Down")
        expect(page.locator("header button.stop")).to_contain_text("robot not reached")
        page.keyboard.press(" ")
        expect(page.get_by_role("alert")).to_contain_text("The robot cannot be reached")
        assert rover.link.stopped
    finally:
        rover.robot.start()
    shows_the_robot(page)
    expect(page.get_by_role("alert")).not_to_contain_text("cannot be reached")


@pytest.mark.parametrize("locale", ["en-US", "zh-CN"])
def test_a_phone_shows_the_whole_reason_why_the_link_is_down(rover: Desk, locale: str) -> None:
    page = rover.page("link", locale=locale, viewport={"width": 390, "height": 844})
    why = page.locator("header .why")
    rover.robot.kill()
    try:
        wait_until(lambda: rover.link.state == "down", "the link is down")

        def said() -> str | None:
            return chinese(rover.link.why) if locale == "zh-CN" else rover.link.why

        wait_until(lambda: said() in why.all_inner_texts(), "the reason")
        fits = "(one) => one.scrollHeight <= one.clientHeight + 1 && one.scrollWidth <= one.clientWidth + 1"
        assert why.evaluate(fits)
        assert why.evaluate("(one) => one.getBoundingClientRect().right <= innerWidth")
        assert why.evaluate("(one) => one.getBoundingClientRect().width") > 200
        assert page.evaluate("document.scrollingElement.scrollWidth") <= 390
    finally:
        rover.robot.start()
    expect(why).not_to_be_visible()
