"""Recordings in the browser: marks and notes, files to download, and files that are damaged."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import expect

import wirebond
from tests.console.browser import Desk, serious
from tests.waiting import wait_until

pytestmark = pytest.mark.live


def cut_short(rover: Desk) -> Path:
    """Copy the file of a recording in progress, as a computer leaves it that loses its power."""
    recordings = rover.server.recordings
    recordings.start()
    came = rover.link.stats.receive.messages.get("odometry", 0)
    wait_until(lambda: rover.link.stats.receive.messages.get("odometry", 0) > came + 20, "something to record")
    assert recordings.folder is not None
    whole = max(recordings.folder.glob("*.mcap"), key=lambda path: path.stat().st_mtime)
    cut = whole.with_name("cut.mcap")
    cut.write_bytes(whole.read_bytes())
    recordings.stop()
    return cut


def test_a_recording_is_marked_noted_and_downloaded_as_mcap_and_csv(rover: Desk, tmp_path: Path) -> None:
    page = rover.page("recordings")
    page.get_by_role("button", name="Record", exact=True).click()
    expect(page.get_by_role("button", name="Stop recording")).to_be_visible()
    page.get_by_role("textbox", name="Mark an event").fill("wheel slips")
    page.keyboard.press("Enter")
    expect(page.get_by_role("log")).to_contain_text("Marked")
    came = rover.link.stats.receive.messages.get("odometry", 0)
    wait_until(lambda: rover.link.stats.receive.messages.get("odometry", 0) > came + 5, "something to record")
    page.get_by_role("button", name="Stop recording").click()
    assert rover.server.recordings.folder is not None
    newest = max(rover.server.recordings.folder.glob("diffdrive-*.mcap")).name  # other tests have recorded as well
    row = page.get_by_role("row").filter(has_text=newest)
    row.get_by_role("button", name="Add a note").click()
    page.get_by_role("textbox", name="Notes").fill("on the wet floor")
    page.keyboard.press("Enter")
    expect(row.locator("td.notes")).to_contain_text("on the wet floor")
    with page.expect_download() as download:
        row.get_by_role("button", name="MCAP", exact=True).click()
    file = tmp_path / "run.mcap"
    download.value.save_as(file)
    marks = [event for event in wirebond.Recording(file).events if event.kind == "mark"]
    assert [mark.facts["text"] for mark in marks] == ["wheel slips"]
    with page.expect_download() as download:
        row.get_by_role("combobox", name="CSV").select_option("odometry")
    table = tmp_path / "run.csv"
    download.value.save_as(table)
    rows = table.read_text().splitlines()
    assert rows[0] == "t,left_ticks,right_ticks" and len(rows) > 5
    row.get_by_role("button", name="Open", exact=True).click()
    page.get_by_role("button", name="wheel slips").click()
    slider = page.get_by_role("slider", name="Position in the recording")
    assert abs(float(slider.input_value()) - marks[0].t) < 0.01
    page.get_by_role("button", name="Back to live").click()


def test_a_recording_that_was_cut_short_opens_as_far_as_it_goes_and_says_what_is_lost(rover: Desk) -> None:
    cut = cut_short(rover)
    none = cut.with_name("none.mcap")
    none.write_bytes(b"no recording at all")
    page = rover.page(f"recordings?recording={cut.name}")
    expect(page.locator(".problems")).to_contain_text("the last whole record")
    expect(page.get_by_role("slider", name="Position in the recording")).to_be_visible()
    expect(page.get_by_role("row", name=none.name)).to_contain_text("is not an MCAP file")
    assert serious(page) == []
    stop = page.get_by_role("button", name="STOP").bounding_box()
    assert stop is not None and stop["x"] + stop["width"] <= 1280
    page.evaluate(f"location.hash = '#/plots?recording={none.name}'")
    expect(page.locator(".scrubber")).to_contain_text("none.mcap")
    page.get_by_role("button", name="Back to live").click()
    expect(page.locator(".legend .value").first).to_have_text(re.compile(r"\d"))


def test_a_raw_capture_is_listed_and_opens_with_the_links_protocol(rover: Desk) -> None:
    folder = rover.server.recordings.folder
    assert folder is not None
    ticks = range(0, 2000, 10)
    capture = folder / "line.bin"
    capture.write_bytes(b"".join(rover.link.codec.encode("odometry", left_ticks=n, right_ticks=0) for n in ticks))
    try:
        page = rover.page("recordings")
        row = page.get_by_role("row", name="line.bin")
        expect(row).to_contain_text("raw capture")
        row.get_by_role("button", name="Open", exact=True).click()
        expect(page.get_by_role("slider", name="Position in the recording")).to_be_visible()
        page.evaluate("location.hash = '#/messages?recording=line.bin'")
        expect(page.get_by_role("row", name=re.compile("odometry"))).to_contain_text("left_ticks 1990")
    finally:
        capture.unlink()
