"""A page without a server shows, drives, stops and records a robot."""

from __future__ import annotations

import time

import pytest
from playwright.sync_api import expect

from tests.page.conftest import Rover, in_control

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
