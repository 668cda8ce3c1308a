"""A page without a server shows, drives, stops and records a robot."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.page.conftest import Rover, in_control, write_page

pytestmark = pytest.mark.live


def test_a_person_chooses_the_port_and_sees_the_robot(rover: Rover) -> None:
    page = rover.seat.connected("messages")
    expect(page.get_by_role("row").filter(has_text="odometry")).to_contain_text("20")


def test_the_robot_drives_while_the_key_is_held_and_stops_when_it_is_let_go(rover: Rover) -> None:
    page = rover.seat.connected("control")
    rover.drive(page)
    page.keyboard.up("ArrowUp")
    expect(page.get_by_text("Let go: zero is sent")).to_be_visible()
    since = time.monotonic()
    rover.robot.wait_for(lambda velocity: velocity.linear == 0, since)


def test_the_emergency_stop_is_latched(rover: Rover) -> None:
    page = rover.seat.connected("control")
    rover.drive(page)
    page.keyboard.press("Space")
    expect(page.get_by_role("alert").first).to_be_visible()
    since = time.monotonic()
    rover.robot.wait_for(lambda velocity: velocity.linear == 0, since)
    expect(in_control(page)).not_to_be_visible()


def test_an_unplugged_port_comes_back(rover: Rover) -> None:
    page = rover.seat.connected("link")
    rover.seat.wire.plug(False)
    expect(page.locator("header .state")).to_contain_text("Down")
    expect(page.locator("header .state")).to_contain_text("unplugged")
    rover.seat.wire.plug(True)
    expect(page.locator("header .state")).to_contain_text("Up")


def test_sentences_of_the_worker_are_chinese_for_a_chinese_reader(rover: Rover) -> None:
    page = rover.seat.connected("link")
    page.keyboard.press("l")
    rover.seat.wire.plug(False)
    expect(page.locator("header .state")).to_contain_text("串口被拔出")
    page.keyboard.press("l")
    expect(page.locator("header .state")).to_contain_text("the port was unplugged")


def test_the_bytes_of_a_frame_are_named(rover: Rover) -> None:
    page = rover.seat.connected("messages")
    page.get_by_role("button", name="▼ odometry").click()
    parts = page.get_by_role("table").last.get_by_role("row")
    for name in ("magic", "id", "payload", "check", "tail"):
        expect(parts.filter(has=page.get_by_role("cell", name=name, exact=True))).to_be_visible()
    expect(parts.filter(has=page.get_by_role("cell", name="magic", exact=True))).to_contain_text("AA 55")
    expect(parts.filter(has=page.get_by_role("cell", name="id", exact=True))).to_contain_text("odometry")


def test_bytes_are_explained_without_a_port_that_sent_them(rover: Rover) -> None:
    page = rover.seat.connected("protocol")
    page.get_by_role("tab", name="Explain bytes").click()
    page.get_by_role("textbox").fill("AA 55 02 00 00 00 00 00 00 FE 0D")
    page.get_by_role("button", name="Explain").click()
    expect(page.get_by_text("check mismatch")).to_be_visible()


def test_a_port_that_is_open_is_closed_before_another_protocol_is_shown(rover: Rover, tmp_path: Path) -> None:
    page = rover.seat.connected("link")
    other = write_page(tmp_path / "other", "native")
    page.get_by_label("Another protocol").set_input_files(other / "protocol.json")
    expect(page.get_by_role("button", name="Disconnect")).not_to_be_visible()
    page.get_by_label("Another protocol").set_input_files(rover.seat.wire.folder / "protocol.json")
    page.get_by_role("button", name="again").click()
    expect(page.locator("header .state")).to_contain_text("Up")
