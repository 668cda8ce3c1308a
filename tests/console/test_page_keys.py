"""The page by keyboard alone, and for people who see it in other ways: every view, in every state of the link."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.console.browser import VIEWS, Desk, open_page, serious, undescribed_device
from tests.console.screenshots import without_port
from tests.waiting import moments, wait_until

pytestmark = pytest.mark.live

# Everything that a mouse can press, and the part of it that the focus has come to.
_CONTROLS = """() => [...document.querySelectorAll('button, input, select, textarea, a[href], [tabindex="0"]')]
  .filter((one) => !one.disabled && one.tabIndex >= 0 && one.checkVisibility())"""
_WATCH = """() => {
  globalThis.reached = new Set();
  document.addEventListener('focusin', (event) => reached.add(event.target));
}"""
_MISSED = f"() => ({_CONTROLS})().filter((one) => !reached.has(one)).map((one) => one.outerHTML.slice(0, 120))"
_FOCUSED = "document.activeElement.tagName === 'BUTTON' ? document.activeElement.innerText : ''"
_MOST = 150  # presses of Tab through one view
# What the server works out, or sends, after the view is there.
_COMES_LATE = {"messages": "td", "protocol": "article pre", "Findings": ".finding"}


def tab_to(page: Page, name: str) -> None:
    """Tab until the focus is on the button of this name."""
    for _ in range(_MOST):
        page.keyboard.press("Tab")
        if name in page.evaluate(_FOCUSED):
            return
    raise AssertionError(f"Tab never comes to {name!r}")


def walk(page: Page) -> None:
    """Tab through the whole view, again and again if controls come meanwhile, until each was reached."""
    page.evaluate(_WATCH)
    for _ in moments(lambda: f"Tab never comes to {page.evaluate(_MISSED)} of {page.url}"):
        for _ in range(page.evaluate(f"({_CONTROLS})().length") + 5):
            page.keyboard.press("Tab")
        if not page.evaluate(_MISSED):
            return


def test_every_control_of_a_view_is_reached_by_tab(rover: Desk) -> None:
    page = rover.page("messages?message=mcu:odometry")
    expect(page.locator(".detail .bytes .byte").first).to_be_visible()
    page.keyboard.press("p")  # nothing comes and goes meanwhile
    walk(page)
    page.evaluate("location.hash = '#/control'")
    expect(page.get_by_role("application")).to_be_visible()
    walk(page)


@pytest.mark.long
def test_every_control_of_all_views_is_reached_by_tab(rover: Desk) -> None:
    page = rover.page("link")
    expect(page.get_by_role("status")).to_contain_text("Up")
    for view in VIEWS:
        page.evaluate(f"location.hash = '#/{view}'")
        if view in _COMES_LATE:
            page.locator(_COMES_LATE[view]).first.wait_for()
        walk(page)
    for part in ("Findings", "Explain bytes", "Edit and try"):
        page.get_by_role("tab", name=part).click()
        if part in _COMES_LATE:
            page.locator(_COMES_LATE[part]).first.wait_for()
        walk(page)


def test_views_are_opened_control_is_taken_and_bytes_are_seen_by_keys_alone(rover: Desk) -> None:
    page = rover.page("link")
    expect(page.get_by_role("status")).to_contain_text("Up")
    tab_to(page, "Messages")
    page.keyboard.press("Enter")
    expect(page.get_by_role("button", name="odometry")).to_be_visible()
    tab_to(page, "odometry")
    page.keyboard.press("Enter")
    expect(page.locator(".detail .bytes .byte").first).to_be_visible()
    page.keyboard.press("c")
    page.evaluate("document.activeElement.blur()")
    tab_to(page, "Take control")
    page.keyboard.press("Enter")
    expect(page.get_by_text("You are in control")).to_be_visible()
    tab_to(page, "Release")
    page.keyboard.press("Enter")
    expect(page.get_by_text("You are in control")).to_have_count(0)
    page.keyboard.press("?")
    expect(page.get_by_role("dialog")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.get_by_role("dialog")).to_have_count(0)


@pytest.mark.long
@pytest.mark.parametrize("look", [{"color_scheme": "dark"}, {"locale": "zh-CN", "color_scheme": "light"}])
def test_no_view_is_hard_to_use_in_any_state(browser: Browser, rover: Desk, look: dict[str, str]) -> None:
    page = rover.page("link", **look)
    expect(page.get_by_role("status")).to_be_visible()
    recordings = rover.server.recordings
    recordings.start()
    came = rover.link.stats.receive.messages.get("odometry", 0)
    wait_until(lambda: rover.link.stats.receive.messages.get("odometry", 0) > came + 5, "something to record")
    name = recordings.stop().name
    found = {}

    def all_views(state: str, page: Page, query: str = "") -> None:
        for view in VIEWS:
            page.evaluate(f"location.hash = '#/{view}{query}'")
            page.wait_for_timeout(700)
            if wrong := serious(page):
                found[state, view] = wrong

    all_views("up", page)
    all_views("recording", page, f"?recording={name}")
    rover.link.emergency_stop()
    all_views("stopped", page)
    rover.link.release_stop()
    rover.robot.kill()
    wait_until(lambda: rover.link.state == "down", "the link is down")
    all_views("down", page)
    rover.robot.start()
    with undescribed_device() as console:
        page = open_page(browser, console, "messages", **look)
        all_views("undescribed", page)
    with without_port() as console:
        page = open_page(browser, console, "link", **look)
        all_views("no port", page)
    assert found == {}
