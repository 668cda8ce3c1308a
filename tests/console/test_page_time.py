"""A recording in the browser is a position in time; what is live beside it says so."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, expect

import wirebond
from tests.console.browser import Desk, desk, serious
from tests.waiting import moments, wait_until

pytestmark = pytest.mark.live
PIXEL = 0.05  # seconds: more than a pixel of `recording` has
ROWS = (5, 20, 12)  # of the odometry of `recording`, whose values differ


@pytest.fixture(scope="module")
def shared_desk(tmp_path_factory: pytest.TempPathFactory, browser: Browser) -> Iterator[Desk]:
    with desk(tmp_path_factory.mktemp("desk"), browser) as made:
        yield made


@pytest.fixture
def rover(shared_desk: Desk) -> Iterator[Desk]:
    """One robot and one server for the tests of this file; each begins without control, stop or tabs."""
    with shared_desk.of_one_test() as one:
        yield one


@pytest.fixture(scope="module")
def recording(shared_desk: Desk) -> str:
    """The name of one with some seconds of the robot, in which much goes wrong. The robot drives in its first half
    second, and nothing came by a pause of the machine between the warning and the mark behind it."""
    folder = shared_desk.server.recordings.folder
    assert folder is not None
    for _ in moments("a recording whose mark comes directly behind its warning"):
        name = recorded(shared_desk)
        found = wirebond.Recording(folder / name)
        if len(set(found.columns("mcu")["odometry"]["left_ticks"][list(ROWS)])) < len(ROWS):
            continue
        events = found.events
        warned, marked = (next(event.t for event in events if event.kind == kind) for kind in ("log", "mark"))
        struck = [event.t for event in events if event.kind == "deadline_struck"]
        if not any(warned <= t <= marked + 0.1 for t in struck):  # marks so close to each other may be one
            return name
    raise AssertionError


def recorded(rover: Desk) -> str:
    link, recordings = rover.link, rover.server.recordings
    rover.robot.ready(link)
    recordings.start()
    link.send("velocity", linear=0.5, angular=0)  # and no more: one second later the robot stops
    came = link.stats.receive.messages.get("odometry", 0)
    wait_until(lambda: link.stats.receive.messages.get("odometry", 0) > came + 10, "something to record")
    frame = bytearray(link.codec.encode("velocity", linear=0, angular=0))
    frame[4] ^= 1
    link.internals.engine.send(0, bytes(frame), -1, False, 0)
    wait_until(lambda: link.stats.receive.messages.get("odometry", 0) > came + 40, "something to record")
    link.note("log", level="warning", text="motor hot", message="report")
    wait_until(lambda: link.stats.receive.messages.get("odometry", 0) > came + 45, "something to record")
    recordings.mark("wheel slips")
    wait_until(lambda: link.stats.receive.messages.get("odometry", 0) > came + 50, "something to record")
    return recordings.stop().name


def test_present_states_have_a_time_of_day_while_a_recording_is_shown(rover: Desk, recording: str) -> None:
    rover.robot.ready(rover.link)
    rover.link.send("velocity", linear=0, angular=0)  # and no more: 3 s later the robot is in its safe mode
    page = rover.page(f"control?recording={recording}")
    since = page.get_by_text(re.compile("^since "))
    expect(since.first).to_have_text(re.compile(r"^since \d\d:\d\d:\d\d$"))


def shown_numbers(text: str) -> set[float]:
    """One, or the least and the greatest of those that came within one pixel."""
    return {float(each) for each in text.replace("\u2212", "-").replace("\u2009", "").split("\u2026")}


def test_the_legend_has_the_values_of_the_position(rover: Desk, recording: str) -> None:
    folder = rover.server.recordings.folder
    assert folder is not None
    odometry = wirebond.Recording(folder / recording).columns("mcu")["odometry"]
    assert odometry.t is not None
    page = rover.page(f"plots?recording={recording}")
    position = page.get_by_role("slider", name="Position in the recording")
    value = page.locator(".legend .value").first
    for row in ROWS:
        position.fill(f"{odometry.t[row] + 0.01:.3f}")
        at = float(position.input_value())
        newest = odometry["left_ticks"][np.searchsorted(odometry.t, at, side="right") - 1]
        beside = set(odometry["left_ticks"][abs(odometry.t - at) < PIXEL]) | {newest}
        expect(value).to_have_text(re.compile(r"\d"))

        def has_it(newest: int = newest, beside: set[int] = beside) -> bool:
            shown = shown_numbers(value.inner_text())
            return min(shown) <= newest <= max(shown) and shown <= beside

        wait_until(has_it, f"the value at {at}: {newest}")


def test_csv_has_every_sample_of_the_range_and_no_more(rover: Desk, recording: str, tmp_path: Path) -> None:
    folder = rover.server.recordings.folder
    assert folder is not None
    odometry = wirebond.Recording(folder / recording).columns("mcu")["odometry"]
    assert odometry.t is not None
    begin, end = float(odometry.t[5]) - 0.001, float(odometry.t[30]) + 0.001
    page = rover.page(f"plots?recording={recording}&from={begin}&to={end}", viewport={"width": 390, "height": 844})
    expect(page.locator(".legend .value").first).to_have_text(re.compile(r"\d"))
    with page.expect_download() as download:
        page.get_by_role("button", name="CSV").click()
    file = tmp_path / "samples.csv"
    download.value.save_as(file)
    with file.open() as opened:
        rows = list(csv.DictReader(opened))
    inside = (begin <= odometry.t) & (odometry.t <= end)  # frames that come in one read have one time
    assert 26 <= inside.sum() < len(odometry.t)
    assert [int(row["odometry.left_ticks [ticks]"]) for row in rows] == odometry["left_ticks"][inside].tolist()
    assert [float(row["t [s]"]) for row in rows] == np.round(odometry.t[inside], 6).tolist()


def test_the_position_is_in_the_address_and_goes_with_the_reader_to_every_view(rover: Desk, recording: str) -> None:
    page = rover.page(f"plots?recording={recording}&from=0.1&to=1.2&at=0.7")
    position = page.get_by_role("slider", name="Position in the recording")
    expect(position).to_have_value(re.compile(r"^0\.7"))
    position.fill("0.5")
    expect(page).to_have_url(re.compile(r"at=0\.5"))
    at = re.search(r"at=([\d.]+)", page.url)
    assert at is not None
    for key in "1234567":
        page.keyboard.press(key)
        for part in (f"at={at[1]}", "from=0.1000&to=1.2000", f"recording={recording}"):
            expect(page).to_have_url(re.compile(re.escape(part)))
    page.keyboard.press("2")
    other = rover.page("link")  # a colleague
    other.goto(page.url)
    expect(other.get_by_role("slider", name="Position in the recording")).to_have_value(position.input_value())
    row = other.get_by_role("row").filter(has=other.get_by_role("button", name="odometry"))
    expect(row.locator(".age")).to_have_text(re.compile(r"^\d+ ms$"))
    assert (
        row.inner_text() == page.get_by_role("row").filter(has=page.get_by_role("button", name="odometry")).inner_text()
    )
    page.go_back()
    expect(page.locator(".scrubber")).to_be_visible()
    page.get_by_role("button", name="Back to live").click()
    expect(page).not_to_have_url(re.compile("at="))


def test_faults_are_marked_on_the_timeline_in_every_view(rover: Desk, recording: str) -> None:
    page = rover.page(f"plots?recording={recording}&at=0.1")
    marks = page.locator(".marks button")
    for name in (
        "warning: motor hot",
        "to the robot discarded",
        "stop at the robot: it was sent no velocity for 1.0 s",
    ):
        expect(marks.and_(page.get_by_role("button", name=name))).to_have_count(1)
    marks.and_(page.get_by_role("button", name="wheel slips")).click()
    expect(page.get_by_role("contentinfo")).to_contain_text("warning: motor hot")
    expect(page.get_by_role("contentinfo").locator(".warn")).to_have_text("warning: motor hot")
    page.keyboard.press("l")
    expect(page.get_by_role("contentinfo").locator(".warn")).to_have_text("警告: motor hot")


def test_every_view_shows_the_moment_or_says_that_it_is_live(rover: Desk, recording: str) -> None:
    page = rover.page(f"link?recording={recording}&at=0.3")
    main = page.locator("main")
    expect(main).to_contain_text("State at 0.300 s")
    odometry = main.get_by_role("row").filter(has_text="odometry")
    assert rover.server.recordings.folder is not None
    messages = wirebond.Recording(rover.server.recordings.folder / recording).messages("mcu")
    expect(odometry.locator("td").last).to_have_text(str(sum(m.name == "odometry" and m.t <= 0.3 for m in messages)))
    expect(main.locator(".losses")).to_contain_text("No byte was discarded")
    expect(main).not_to_contain_text("stop at the robot")
    page.get_by_role("slider", name="Position in the recording").press("End")
    expect(main.locator(".state")).to_contain_text("stop at the robot: it was sent no velocity for 1.0 s")
    expect(main.locator(".losses")).to_contain_text(re.compile(r"To the robot\s*[1-9]\d* bytes"))
    main.get_by_role("button", name="Show the bytes").click()
    expect(main.locator(".entry.discarded")).to_have_count(1)
    expect(main.locator(".events")).to_contain_text("warning: motor hot")
    assert serious(page) == []
    expect(page.locator("header").get_by_role("status")).to_contain_text(re.compile("^Live: "))
    page.keyboard.press("7")
    expect(main).to_contain_text("This is the protocol that the recording was made with")
    expect(main).to_contain_text("Velocity commands to a two-wheeled base")
    page.get_by_role("tab", name="Edit and try").click()
    expect(main).to_contain_text("The editor has the file of the live link")
    for key in "45":
        page.keyboard.press(key)
        expect(main).to_contain_text("Commands that you send go to the robot now")
    page.get_by_role("button", name="Back to live").click()
    page.keyboard.press("1")
    expect(main).to_contain_text("Connect to another port")
