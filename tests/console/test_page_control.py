"""A press of a person on the page has its effect, or the page says why not: control and the emergency stop."""

from __future__ import annotations

import contextlib
import re
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

import wirebond
from tests.console.browser import Desk, desk, shows_the_robot, take_control, with_told
from tests.suspended import stalled
from tests.waiting import PATIENCE, let_pass, moments, wait_until
from wirebond.link.attached import words
from wirebond.seldom import EVERY
from wirebond.server.command_log import Command
from wirebond.server.control import ControlBook

pytestmark = pytest.mark.live
LATE = words.OLDEST_COMMAND + 2 * words.TICK_EVERY  # seconds
TOO_LATE = re.compile(
    "“Take control” had no effect: .* Check the robot, then press it again|lost before it answered “Take control”"
)


@pytest.fixture(scope="module")
def shared_desk(tmp_path_factory: pytest.TempPathFactory, browser: Browser) -> Iterator[Desk]:
    with desk(tmp_path_factory.mktemp("desk"), browser) as made:
        yield made


@pytest.fixture
def rover(shared_desk: Desk) -> Iterator[Desk]:
    with shared_desk.of_one_test() as one:
        yield one


PRESS = "(one) => one.isConnected && !one.disabled && (one.click(), true)"  # a click would wait


def press_in_a_stall(rover: Desk, button: Locator, seconds: float, then: Callable[[], None] = lambda: None) -> None:
    """Press the button while the server does nothing, also for these seconds after the press. ``then``: called after
    the press. Where this machine is too busy, the page notices the silence before the press, and it is tried again."""
    for _ in moments("a press in time"):
        expect(button).to_be_enabled()
        found = button.element_handle()
        with stalled(rover.server._owner.loop):
            if found.evaluate(PRESS):
                then()
                let_pass(seconds)
                return
    raise AssertionError


def taking(page: Page) -> Locator:
    return page.locator("header").get_by_role("button", name="Take control")


def in_control(page: Page) -> Locator:
    return page.get_by_text("You are in control")


def second_click(button: Locator) -> None:
    """Send the second click of a double click to a button that was not there at the first."""
    button.hover()
    button.page.mouse.down(click_count=2)
    button.page.mouse.up(click_count=2)


def releases(rover: Desk) -> list[Command]:
    return [one for one in rover.server.log.commands() if one.do == "release_stop"]


def said(page: Page) -> Locator:
    return page.locator(".notice")


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The ticks of requests whose age the server judged; it calls the first one late, also after ``clear``."""
    found: list[int] = []
    late = ControlBook.late

    def late_at_first(book: ControlBook, tick: int, now: float) -> str | None:
        found.append(tick)
        return "it came late" if len(found) == 1 else late(book, tick, now)

    monkeypatch.setattr(ControlBook, "late", late_at_first)
    return found


def test_a_press_that_came_late_is_sent_again(rover: Desk, asked: list[int]) -> None:
    """The server calls the first one late. On a busy machine the page may hear that so late that it does not send it
    again; then it says so."""
    page = rover.page("control")
    for _ in moments("it is sent again"):
        asked.clear()
        taking(page).click()
        expect(in_control(page).or_(said(page)).first).to_be_visible()
        if in_control(page).is_visible():
            break
        expect(said(page).first).to_have_text(TOO_LATE)
        said(page).first.get_by_role("button").click()
    assert len(asked) == 2


@pytest.mark.usefixtures("real_ages")
@pytest.mark.parametrize("locale", ["en-US", "zh-CN"])
def test_a_press_that_came_too_late_says_so_and_what_to_do(rover: Desk, locale: str) -> None:
    page = rover.page("control", locale=locale)
    button = page.locator("header").get_by_role("button", name="Take control" if locale == "en-US" else "取得控制权")
    press_in_a_stall(rover, button, 2.2)
    chinese = re.compile("“取得控制权”没有生效：.*再按一次|在它回答“取得控制权”之前断开")  # noqa: RUF001
    expect(said(page).first).to_have_text(TOO_LATE if locale == "en-US" else chinese)
    assert rover.server.holder is None


@pytest.mark.usefixtures("real_ages")
def test_nothing_is_taken_by_a_late_press_after_the_robot_was_stopped(rover: Desk) -> None:
    page = rover.page("control")
    press_in_a_stall(rover, taking(page), LATE, lambda: page.keyboard.press(" "))
    expect(page.get_by_role("alert").filter(has_text="Emergency stop")).to_be_visible()
    expect(said(page).first).to_have_text(TOO_LATE)
    assert rover.server.holder is None


def test_nothing_is_taken_by_a_late_press_after_another_program_released_the_stop(
    rover: Desk, asked: list[int]
) -> None:
    page = rover.page("control")
    for _ in moments("a press before the release is told"):
        rover.link.emergency_stop()
        expect(page.get_by_role("alert")).to_be_visible()
        asked.clear()
        found = taking(page).element_handle()
        with stalled(rover.server._owner.loop):
            rover.link.release_stop()
            if found.evaluate(PRESS):
                break
    expect(in_control(page).or_(said(page)).first).to_be_visible()
    expect(said(page).first).to_have_text(TOO_LATE)
    assert rover.server.holder is None


def test_control_that_is_taken_at_the_moment_of_a_release_stays(rover: Desk) -> None:
    page = rover.page("control")
    shows_the_robot(page)
    rover.link.emergency_stop()
    wait_until(lambda: rover.server.stopped_by is not None, "the server has seen the stop")
    expect(page.get_by_role("alert")).to_be_visible()
    found = taking(page).element_handle()
    with stalled(rover.server._owner.loop):
        rover.link.release_stop()
        expect(page.get_by_role("alert")).to_have_count(0)
        is_pressed = found.evaluate(PRESS)
    if not is_pressed:  # this machine is busy
        taking(page).click()
    expect(in_control(page).or_(said(page)).first).to_be_visible()
    if said(page).count():  # this machine is busy
        expect(said(page).first).to_have_text(TOO_LATE)
        take_control(page)
    ticks = rover.server._owner.book.ticks
    before = ticks.newest
    wait_until(lambda: ticks.newest > before + 2, "the server has looked at the stop")
    assert rover.server.holder is not None or said(page).count() > 0


def test_a_page_whose_control_ends_with_a_release_says_so(rover: Desk) -> None:
    page = rover.page("control")
    rover.link.emergency_stop()
    expect(page.get_by_role("alert")).to_be_visible()
    take_control(page)
    rover.link.release_stop()
    expect(said(page).filter(has_text="The release of the emergency stop ended every control")).to_be_visible()
    take_control(page)  # a person's press needs no second one, although another program released


def test_a_page_that_loses_its_connection_says_that_its_control_has_ended(rover: Desk) -> None:
    page = rover.page("control")
    take_control(page)
    owner = rover.server._owner

    def cut() -> None:
        for client in [*owner.clients.values()]:
            client.end()

    owner.loop.call_soon_threadsafe(cut)
    expect(said(page).filter(has_text="this page is no longer in control")).to_be_visible()
    expect(page.locator("header")).to_contain_text("No program is in control")


def test_the_page_that_stopped_releases_by_one_press(rover: Desk) -> None:
    page = rover.page("control")
    shows_the_robot(page)
    page.keyboard.press(" ")
    banner = page.get_by_role("alert").filter(has_text="Emergency stop")
    expect(banner).to_be_visible()
    banner.get_by_role("button", name="Release the stop").click()
    expect(page.get_by_role("alert")).to_have_count(0)
    assert not rover.link.stopped
    take_control(page)


@pytest.mark.parametrize("locale", ["en-US", "zh-CN"])
def test_the_stop_of_another_program_is_released_by_a_second_press_that_names_it_and_is_logged(
    rover: Desk, locale: str, caplog: pytest.LogCaptureFixture
) -> None:
    page = rover.page("control", locale=locale)
    expect(page.locator("header button.stop")).to_be_enabled()
    texts = {
        "en-US": ("Release the stop", "Yes, release the stop by", "Check the robot", "Cancel"),
        "zh-CN": ("解除急停", "确认解除", "请先查看机器人", "取消"),
    }
    first, second, look, cancel = texts[locale]
    with wirebond.open(f"wirebond://{rover.server.path}") as pad:
        pad.emergency_stop()
        name = rover.server.stopped_by
        assert name is not None
        banner = page.get_by_role("alert")
        release = banner.get_by_role("button", name=first, exact=True)
        release.dblclick()
        sure = banner.get_by_role("button", name=second)
        expect(sure).to_contain_text(name)
        expect(banner).to_contain_text(look)
        assert rover.link.stopped
        banner.get_by_role("button", name=cancel).click()
        release.click()
        expect(sure).to_be_visible()
        pad.release_stop()
        expect(banner).to_have_count(0)
        pad.emergency_stop()
        expect(release).to_be_visible()  # another stop is another decision
        let_pass(EVERY)  # the log has one line in this time
        release.click()
        sure.click()
        expect(banner).to_have_count(0)
        assert not rover.link.stopped
    done = releases(rover)[-1]
    assert done.name.startswith("console ")
    told = {"en-US": f"{done.name} released the emergency stop by {name}", "zh-CN": f"{done.name} 解除了 {name} 的急停"}
    expect(page.locator("footer").get_by_text(told[locale])).to_be_visible()
    assert done.error == ""
    wait_until(lambda: f"{done.name} released the emergency stop by {name}" in caplog.text, lambda: caplog.text)


def test_a_form_keeps_what_was_typed_while_its_repetition_ends_with_the_view(rover: Desk) -> None:
    page = rover.page("control")
    take_control(page)
    form = page.get_by_role("form", name="velocity")
    linear = form.get_by_role("spinbutton", name="linear")
    linear.fill("0.4")
    form.get_by_role("button", name=re.compile("^Repeat")).click()
    expect(form.get_by_role("button", name=re.compile("^Repeating"))).to_be_visible()
    page.locator("nav").get_by_role("button", name="Plots").click()
    expect(said(page).filter(has_text="velocity is no longer repeated, because its form was left")).to_be_visible()
    page.locator("nav").get_by_role("button", name="Control").click()
    expect(linear).to_have_value("0.4")
    expect(form.get_by_role("button", name=re.compile("^Repeat "))).to_be_visible()
    form.get_by_role("button", name="Default values").click()
    expect(linear).to_have_value("0")


def test_while_a_stop_holds_a_form_says_that_it_is_not_held_back(rover: Desk) -> None:
    page = rover.page("control")
    shows_the_robot(page)
    warning = "The emergency stop does not hold this message back"
    expect(page.get_by_text(warning)).to_have_count(0)
    rover.link.emergency_stop()
    expect(page.get_by_role("form", name="parameter").get_by_text(warning)).to_be_visible()
    expect(page.get_by_role("form", name="velocity").get_by_text(warning)).to_have_count(0)


def test_a_double_click_is_no_second_thought_whatever_its_first_click_put_there(rover: Desk) -> None:
    page = rover.page("control")
    shows_the_robot(page)
    asked = sum(one.count for one in releases(rover))
    with wirebond.open(f"wirebond://{rover.server.path}") as pad:
        pad.emergency_stop()
        banner = page.get_by_role("alert")
        release = banner.get_by_role("button", name="Release the stop")
        question = banner.get_by_role("button", name="Yes, release the stop by")
        cancel = banner.get_by_role("button", name="Cancel")
        release.click()
        expect(question).to_be_visible()
        second_click(cancel)
        second_click(question)
        assert question.is_visible()
        cancel.click()
        second_click(release)
        release.click()
        question.click()
        expect(banner).to_have_count(0)
    assert sum(one.count for one in releases(rover)) == asked + 3


def test_the_question_stays_if_the_page_learns_only_later_who_stopped(rover: Desk) -> None:
    page = rover.page("control")
    withheld: dict[str, Any] = {"stopped_by": None}
    with_told(page, "link", withheld)
    shows_the_robot(page)
    with wirebond.open(f"wirebond://{rover.server.path}") as pad:
        pad.emergency_stop()
        banner, name = page.get_by_role("alert"), rover.server.stopped_by or ""
        banner.get_by_role("button", name="Release the stop").click()
        sure = banner.get_by_role("button", name="Yes, release the stop by")
        expect(sure).to_contain_text(name)
        withheld.clear()
        expect(banner.locator("span")).to_contain_text(name)
        sure.click()
        expect(banner).to_have_count(0)
    assert not rover.link.stopped


def test_a_program_that_asks_in_a_loop_loses_to_the_person_who_released(rover: Desk) -> None:
    page = rover.page("control")
    shows_the_robot(page)
    page.keyboard.press(" ")
    expect(page.get_by_role("alert").filter(has_text="Emergency stop")).to_be_visible()
    ends = threading.Event()
    with wirebond.open(f"wirebond://{rover.server.path}") as hammers:

        def hammer() -> None:
            while not ends.is_set():
                with contextlib.suppress(wirebond.WirebondError):
                    hammers.take_control()

        thread = threading.Thread(target=hammer)
        thread.start()
        try:
            expect(page.locator("header")).to_contain_text("is in control")  # while the stop holds
            page.get_by_role("button", name="Release the stop").click()
            expect(page.get_by_role("alert")).to_have_count(0)
            take_control(page)
        finally:
            ends.set()
            thread.join(PATIENCE)
