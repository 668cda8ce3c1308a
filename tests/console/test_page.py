"""The console's page in a browser, against the real server, a real pty and a simulated robot in another process."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.console.browser import CHROMIUM, VIEWS, Desk, Velocity, chromium, desk, serious, wait_until
from tests.shared import ROOT
from wirebond.console import Console

PHONE = {"width": 390, "height": 844}


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def shared_desk(tmp_path_factory: pytest.TempPathFactory, browser: Browser) -> Iterator[Desk]:
    with desk(tmp_path_factory.mktemp("desk"), browser) as made:
        yield made


@pytest.fixture
def rover(shared_desk: Desk) -> Iterator[Desk]:
    """One robot and one server for the tests of this file; each begins without control, stop or tabs."""
    shared_desk.problems.clear()
    yield shared_desk
    for context in shared_desk.browser.contexts:
        context.close()
    shared_desk.link.release_stop()
    wait_until(lambda: shared_desk.server.holder is None, "nobody is in control")
    assert shared_desk.problems == []


def take_control(page: Page) -> None:
    page.locator("header").get_by_role("button", name="Take").click()
    expect(page.get_by_text("You are in control")).to_be_visible()


def drive(page: Page, rover: Desk, since: float) -> Velocity:
    """Holds the key until the robot moves. On a busy machine a page can be silent for the 0.3 s that end control; then
    nothing drives by itself, and it is taken again."""
    control = page.get_by_text("You are in control")
    for _ in range(10):
        if not control.is_visible():
            take_control(page)
        page.get_by_role("application").focus()
        page.keyboard.up("ArrowUp")
        page.keyboard.down("ArrowUp")
        end = time.monotonic() + 2
        while time.monotonic() < end and control.is_visible():
            if moving := [v for v in rover.robot.velocities if v.t > since and v.linear > 0]:
                return moving[0]
    raise AssertionError("the robot does not move")


def shows_the_robot(page: Page) -> None:
    expect(page.get_by_role("status").filter(has_text="Up")).to_be_visible()


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


def test_the_pad_drives_while_a_key_is_held_and_stops_when_it_is_let_go(rover: Desk) -> None:
    page = rover.page("control")
    pad = page.get_by_role("application")
    pad.focus()
    began = time.monotonic()
    page.keyboard.down("ArrowUp")
    page.keyboard.up("ArrowUp")
    take_control(page)
    assert all(velocity.linear == 0 for velocity in rover.robot.velocities if velocity.t > began)
    driving = drive(page, rover, began)
    assert driving.linear == 1.0  # half of the range
    page.keyboard.up("ArrowUp")
    stopped = rover.robot.wait_for(lambda v: v.linear == 0, driving.t)
    time.sleep(0.3)
    assert all(velocity.linear == 0 for velocity in rover.robot.velocities if velocity.t > stopped.t)

    box = pad.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"], box["y"] + box["height"] / 2)
    turning = rover.robot.wait_for(lambda v: v.angular < -1.5, stopped.t)
    page.evaluate("window.dispatchEvent(new Event('blur'))")  # the driver looks elsewhere
    rover.robot.wait_for(lambda v: v.angular == 0, turning.t)
    page.mouse.up()


def test_control_is_handed_over_only_by_a_deliberate_act(rover: Desk) -> None:
    first, second = rover.page("control"), rover.page("control")
    take_control(first)
    expect(second.locator("header")).to_contain_text("is in control")
    expect(second.get_by_role("form", name="velocity").get_by_role("button", name="Send once")).to_be_disabled()
    began = time.monotonic()
    driving = drive(first, rover, began)
    second.locator("header").get_by_role("button", name="Take over").click()
    expect(second.get_by_text("You are in control")).to_be_visible()
    rover.robot.wait_for(lambda v: v.linear == 0, driving.t)
    expect(first.get_by_text("You are in control")).not_to_be_visible()
    assert rover.robot.velocities[-1].linear == 0


def test_space_stops_the_robot_and_the_stop_stays_until_it_is_released_in_two_steps(rover: Desk) -> None:
    page = rover.page("control")
    take_control(page)
    began = time.monotonic()
    driving = drive(page, rover, began)
    page.keyboard.press(" ")
    rover.robot.wait_for(lambda v: v.linear == 0, driving.t)
    expect(page.get_by_role("alert").filter(has_text="Emergency stop")).to_be_visible()
    assert rover.link.stopped
    page.keyboard.up("ArrowUp")
    page.keyboard.press("2")
    expect(page.get_by_role("alert").filter(has_text="Emergency stop")).to_be_visible()
    assert serious(page) == []
    page.get_by_role("button", name="Release the stop…").click()
    assert rover.link.stopped
    page.get_by_role("button", name="Yes, release the stop").click()
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
    console = Console(port=0)
    console.show(rover.link, rover.server)
    context = browser.new_context(locale="en-US")
    page = context.new_page()
    page.goto(f"{console.address}#/control")
    take_control(page)
    port = console.port
    console.close()
    expect(page.get_by_role("status")).to_contain_text("The server does not answer")
    with Console(port=port) as again:
        again.show(rover.link, rover.server)
        shows_the_robot(page)
        expect(page.locator("header")).to_contain_text("No program is in control")
        context.close()


@pytest.mark.long
def test_a_cable_that_is_pulled_is_named_and_the_page_goes_on_when_it_is_back(rover: Desk) -> None:
    page = rover.page("messages")
    shows_the_robot(page)
    rover.robot.kill()
    expect(page.get_by_role("status")).to_contain_text("Down")
    rover.robot.start()
    shows_the_robot(page)


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
        page.goto("about:blank")
        page.goto(console.address)
        shows_the_robot(page)
        assert "to-k_en" not in page.url


@pytest.mark.long
def test_a_page_that_hangs_without_closing_leaves_no_robot_driving(rover: Desk) -> None:
    """All its processes are stopped, as by a laptop that is shut: no heartbeat, and no end of the connection."""
    word = f"--user-agent-product={time.monotonic_ns()}"
    other = rover.browser.browser_type.launch(executable_path=str(CHROMIUM), args=["--no-sandbox", word])
    with contextlib.closing(other):
        page = other.new_page()
        page.goto(f"{rover.console.address}#/control")
        drive(page, rover, time.monotonic())
        hung = processes(word)
        stopped_at = time.monotonic()
        for pid in hung:
            os.kill(pid, signal.SIGSTOP)
        try:
            rover.robot.wait_for(lambda v: v.linear == 0, stopped_at)
            wait_until(lambda: rover.server.holder is None, "control ends")
        finally:
            for pid in hung:
                os.kill(pid, signal.SIGCONT)
        page.keyboard.up("ArrowUp")
        expect(page.get_by_text("You are in control")).not_to_be_visible()


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


@pytest.mark.long
def test_what_needs_no_browser_holds(tmp_path: Path) -> None:
    if shutil.which("node") is None or not (ROOT / "console" / "node_modules").exists():
        pytest.skip("the page's packages are not installed: that needs Node, as setup/page.sh says")
    done = subprocess.run(
        ["npm", "test", "--silent"], cwd=ROOT / "console", capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
