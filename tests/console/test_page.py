"""The console's page in a browser, against the real server, a real pty and a simulated robot in another process."""

from __future__ import annotations

import re
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from tests.console.browser import (
    VIEWS,
    Desk,
    desk,
    open_page,
    press,
    serious,
    shows_the_robot,
    take_control,
)
from tests.shared import ROOT, lasting_port
from tests.waiting import let_pass, moments, wait_until
from wirebond.console import Console

pytestmark = pytest.mark.live

PHONE = {"width": 390, "height": 844}


@pytest.fixture(scope="module")
def shared_desk(tmp_path_factory: pytest.TempPathFactory, browser: Browser) -> Iterator[Desk]:
    with desk(tmp_path_factory.mktemp("desk"), browser) as made:
        made.robot.ready(made.link)
        made.link.send("velocity", linear=0, angular=0)  # and no more: 3 s later the robot is in its safe mode
        yield made


@pytest.fixture
def rover(shared_desk: Desk) -> Iterator[Desk]:
    """One robot and one server for the tests of this file; each begins without control, stop or tabs."""
    with shared_desk.of_one_test() as one:
        yield one


def test_every_view_shows_the_robot_and_is_accessible(rover: Desk) -> None:
    page = rover.page()
    seen = {
        "link": "Rates against the schedule",
        "messages": "left_ticks",
        "plots": "odometry.left_ticks",
        "control": "Wanted speed of the base",
        "tuning": "max_linear",
        "recordings": "No recording yet",
        "protocol": "Velocity commands to a two-wheeled base",
    }
    shows_the_robot(page)
    for number, view in enumerate(VIEWS, start=1):
        page.keyboard.press(str(number))
        expect(page.locator("main")).to_contain_text(seen[view])
        assert f"#/{view}" in page.url
        expect(page.get_by_role("button", name="STOP")).to_be_visible()
        assert serious(page) == [], view


def test_a_value_is_one_click_from_its_bytes_and_their_meaning(rover: Desk) -> None:
    page = rover.page("messages")
    page.get_by_role("button", name="odometry").click()
    expect(page).to_have_url(re.compile("message=mcu"))
    expect(page.locator(".detail")).to_contain_text("begins every frame")
    expect(page.locator(".detail .bytes .byte").first).to_have_text("AA")
    age = page.locator("tr", has_text="odometry").first.locator(".age")
    expect(age).to_have_text(re.compile(r"^\d+ ms$"))
    page.locator("h2", has_text="odometry").click()
    page.keyboard.press("p")
    frozen = page.locator("tr", has_text="odometry").first.locator(".fields").inner_text()
    came = rover.link.stats.receive.messages["odometry"]
    wait_until(lambda: rover.link.stats.receive.messages["odometry"] > came + 5, "more of it comes")
    assert page.locator("tr", has_text="odometry").first.locator(".fields").inner_text() == frozen


@pytest.mark.parametrize("place", ["header", "main"])
def test_the_arrow_keys_drive_when_control_was_taken(rover: Desk, place: str) -> None:
    page = rover.page("control")
    pad = page.get_by_role("application")
    take = page.locator(place).get_by_role("button", name="Take control")
    press(page, take, page.get_by_text("You are in control").is_visible, "control")
    expect(pad).to_be_focused()
    page.keyboard.press("1")
    page.keyboard.press("4")
    expect(pad).to_be_focused()


def test_the_pad_drives_while_a_key_is_held_and_stops_when_it_is_let_go(rover: Desk) -> None:
    page = rover.page("control")
    pad = page.get_by_role("application")
    pad.focus()
    began = time.monotonic()
    page.keyboard.down("ArrowUp")
    page.keyboard.up("ArrowUp")
    take_control(page)
    expect(page.locator(".pad")).to_contain_text("The robot ignores this: safe_mode has struck")
    pad.focus()
    page.keyboard.down("ArrowUp")
    expect(page.get_by_text("Sent, and ignored by the robot")).to_be_visible()
    page.get_by_role("button", name="Ask").click()
    expect(page.locator(".held")).to_contain_text("errors: encoder")
    assert serious(page) == []
    assert all(velocity.linear == 0 for velocity in rover.robot.since(began))
    end, held = page.get_by_role("button", name="End safe_mode"), page.locator(".held")
    press(page, end, lambda: held.count() == 0, "the end of the safe mode")
    page.keyboard.up("ArrowUp")
    driving = rover.drive(page)
    assert driving.linear == 1.0  # half of the range
    stopped = rover.let_go(page)
    rover.robot.wait_for(lambda v: v.linear == 0, stopped)
    let_pass(0.3)
    assert all(velocity.linear == 0 for velocity in rover.robot.since(stopped))

    pad.hover()  # waits until the page does not move; its middle
    page.mouse.down()
    box = pad.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"], box["y"] + box["height"] / 2)
    turning = rover.robot.wait_for(lambda v: v.angular < -1.5, stopped)
    page.evaluate("window.dispatchEvent(new Event('blur'))")  # the driver looks elsewhere
    rover.robot.wait_for(lambda v: v.angular == 0, turning.t)
    page.mouse.up()


def test_a_released_pad_repeats_zero_so_that_a_pause_does_not_end_in_safe_mode(rover: Desk) -> None:
    page = rover.page("control")
    rover.drive(page)
    released = rover.let_go(page)
    rover.robot.wait_for(lambda v: v.linear == 0, released + 4)  # safe mode would hold after 3 s
    assert all(v.linear == 0 and v.angular == 0 for v in rover.robot.since(released))
    expect(page.locator(".held")).to_have_count(0)
    form = page.get_by_role("form", name="velocity")
    form.get_by_role("spinbutton", name="linear").fill("0.5")
    form.get_by_role("button", name="Send once").click()  # the pad gives way
    once = rover.robot.wait_for(lambda v: v.linear == 0.5, released)
    let_pass(0.3)
    assert rover.robot.velocities[-1].linear == 0.5
    page.get_by_role("application").focus()
    page.keyboard.down("ArrowUp")
    driving = rover.robot.wait_for(lambda v: v.linear == 1.0, once.t)
    page.keyboard.up("ArrowUp")
    rover.robot.wait_for(lambda v: v.linear == 0, driving.t)
    page.keyboard.press("1")
    for _ in moments("a second without a zero: another view sends none"):
        before = len(rover.robot.velocities)
        let_pass(1)
        if len(rover.robot.velocities) == before:
            break


def test_unreachable_actions_are_not_offered_and_unread_values_are_not_shown(rover: Desk) -> None:
    page = rover.page("tuning")
    expect(page.locator("main")).to_contain_text(
        "No message of this protocol reads back the values that parameter sets"
    )
    expect(page.locator("td.in-force").first).to_have_text("not read back")
    page.get_by_role("spinbutton", name="max_linear", exact=True).fill("1")
    page.get_by_role("button", name="Send changes").click()
    expect(page.locator("td.state").filter(has_text="sent, nothing confirms it")).to_have_count(1)
    rover.robot.kill()
    try:
        expect(page.get_by_text("The robot cannot be reached, so nothing can be sent")).to_be_visible()
        page.keyboard.press("4")
        expect(page.get_by_text("The robot cannot be reached, so nothing can be sent")).to_be_visible()
        expect(page.locator(".pad")).to_contain_text("The robot cannot be reached.")
        form = page.get_by_role("form", name="status_query")
        expect(form).to_contain_text("The robot cannot be reached.")
        expect(form.get_by_role("button", name="Send once")).to_be_disabled()
    finally:
        rover.robot.start()
    expect(form.get_by_role("button", name="Send once")).to_be_enabled()


def test_control_is_handed_over_only_by_a_deliberate_act(rover: Desk) -> None:
    first, second = rover.page("control"), rover.page("control")
    take_control(first)
    expect(second.locator("header")).to_contain_text("is in control")
    expect(second.get_by_role("form", name="velocity").get_by_role("button", name="Send once")).to_be_disabled()
    driving = rover.drive(first)
    name = rover.server.holder
    second.locator("header").get_by_role("button", name="Take over…").click()
    sure = second.locator("header").get_by_role("button", name=f"Yes, take over from {name}", exact=True)
    expect(sure).to_be_visible()
    assert rover.server.holder == name
    second.locator("header").get_by_role("button", name="Cancel").click()
    expect(sure).to_have_count(0)
    second.locator("header").get_by_role("button", name="Take over…").dblclick()
    expect(sure).to_be_visible()
    assert rover.server.holder == name
    sure.click()
    expect(second.get_by_text("You are in control")).to_be_visible()
    expect(first.get_by_role("log")).to_contain_text("Another program has taken over control")
    rover.robot.wait_for(lambda v: v.linear == 0, driving.t)
    expect(first.get_by_text("You are in control")).not_to_be_visible()
    rover.robot.ready(rover.link)
    assert rover.robot.velocities[-1].linear == 0


def test_space_stops_the_robot_and_the_stop_stays_until_it_is_released(rover: Desk) -> None:
    page = rover.page("control")
    take_control(page)
    driving = rover.drive(page)
    page.keyboard.press(" ")
    rover.robot.wait_for(lambda v: v.linear == 0, driving.t)
    expect(page.get_by_role("alert").filter(has_text="Emergency stop")).to_be_visible()
    assert rover.link.stopped
    page.keyboard.up("ArrowUp")
    page.keyboard.press("2")
    expect(page.get_by_role("alert").filter(has_text="Emergency stop")).to_be_visible()
    assert serious(page) == []
    page.get_by_role("button", name="Release the stop").click()
    expect(page.get_by_role("alert")).to_have_count(0)
    assert not rover.link.stopped


def test_a_recording_is_made_opened_and_scrubbed_with_the_same_views(rover: Desk) -> None:
    page = rover.page("recordings")
    page.get_by_role("button", name="Record", exact=True).click()
    came = rover.link.stats.receive.messages.get("odometry", 0)
    wait_until(lambda: rover.link.stats.receive.messages.get("odometry", 0) > came + 10, "something to record")
    page.get_by_role("button", name="Stop recording").click()
    page.get_by_role("button", name="Open", exact=True).click()
    slider = page.get_by_role("slider", name="Position in the recording")
    expect(slider).to_be_visible()
    expect(page.locator(".legend .value").first).to_have_text(re.compile(r"\d"))
    page.keyboard.press("2")
    slider.fill("0.2")
    row = page.locator("tr", has_text="odometry").first.locator(".fields")
    expect(row).to_contain_text("left_ticks")
    first = row.inner_text()
    slider.fill(slider.get_attribute("max") or "")
    expect(row).not_to_have_text(first)
    page.get_by_role("button", name="Back to live").click()
    expect(slider).to_have_count(0)


def test_a_server_that_is_gone_is_named_and_comes_back_without_control(
    browser: Browser, tmp_path: Path, rover: Desk
) -> None:
    console = Console(port=lasting_port())
    console.show(rover.link, rover.server)
    page = open_page(browser, console, "control")
    take_control(page)
    console.close()
    expect(page.locator("header").get_by_role("status")).to_contain_text("The server does not answer")
    with Console(port=console.port, token=console.token) as again:
        again.show(rover.link, rover.server)
        shows_the_robot(page)
        expect(page.locator("header")).to_contain_text("No program is in control")
        page.context.close()


def test_the_page_speaks_chinese_and_fits_a_phone(rover: Desk) -> None:
    page = rover.page(locale="zh-CN", viewport=PHONE, has_touch=True)
    expect(page.get_by_role("button", name="急停")).to_be_visible()
    expect(page.locator("html")).to_have_attribute("lang", "zh-CN")
    for view in VIEWS:
        page.evaluate(f"location.hash = '#/{view}'")
        expect(page.locator("nav [aria-current=page]")).to_be_visible()
        box = page.get_by_role("button", name="急停").bounding_box()
        assert box is not None and box["x"] >= 0 and box["x"] + box["width"] <= PHONE["width"], view
        assert page.evaluate("document.scrollingElement.scrollWidth") <= PHONE["width"], view
    assert serious(page) == []


def test_a_page_without_the_token_says_so_and_shows_nothing(rover: Desk) -> None:
    with Console(port=0, token="to-k_en.~9") as console:
        console.show(rover.link, rover.server)
        page = rover.page()
        page.goto(console.address.split("#")[0])
        expect(page.get_by_role("status")).to_contain_text("refuses this page")
        expect(page.get_by_text("odometry")).to_have_count(0)
        page.get_by_label("Address or token").fill(console.address)
        page.get_by_role("button", name="Try again").click()
        shows_the_robot(page)
        page.goto("about:blank")
        page.goto(console.address)
        shows_the_robot(page)
        assert "to-k_en" not in page.url


@pytest.mark.long
def test_tests_without_a_browser_pass(tmp_path: Path) -> None:
    if shutil.which("node") is None or not (ROOT / "console" / "node_modules").exists():
        pytest.skip("the page's packages are not installed: that needs Node, as setup/page.sh says")
    done = subprocess.run(
        ["npm", "test", "--silent"], cwd=ROOT / "console", capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
