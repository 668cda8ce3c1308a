"""The drive of ``wirebond demo`` beside the console: it gives way to a person, but not to a busy computer."""

from __future__ import annotations

import threading
import time
from typing import cast

import pytest

import wirebond
from tests.console.conftest import Desk
from tests.waiting import PATIENCE, wait_until
from wirebond.cli.commands.demo_console import drive
from wirebond.sim.rover import RoverProcess

pytestmark = pytest.mark.live


class NoRover:
    """A stand-in for the rover's process; keeps the orders of the drive."""

    def __init__(self) -> None:
        self.may_step = threading.Event()
        self.may_step.set()
        self.waits = threading.Event()

    def tell(self, line: str) -> None:
        pass

    def events(self) -> list[str]:
        self.waits.set()
        assert self.may_step.wait(PATIENCE)
        return []


def test_the_drive_does_not_go_on_after_a_stop_that_was_released_between_two_of_its_steps(desk: Desk) -> None:
    address = f"wirebond://{desk.server.path}"
    with wirebond.open(desk.codec, address) as link, wirebond.open(desk.codec, address) as person:
        rover = NoRover()
        end = time.monotonic() + 2 * PATIENCE
        driving = threading.Thread(target=drive, args=(link, cast(RoverProcess, rover), end))
        rover.may_step.clear()
        driving.start()
        assert rover.waits.wait(PATIENCE)
        person.emergency_stop()
        person.release_stop()
        rover.may_step.set()
        driving.join(PATIENCE)
        assert not driving.is_alive()
        assert desk.server.holder is None


def test_the_drive_goes_on_after_a_silence_and_ends_where_a_person_takes_control(desk: Desk) -> None:
    heard = desk.codec.decoder("host")

    def wait_for_speed(linear: float) -> None:
        wait_until(
            lambda: any(m.name == "velocity" and m["linear"] == linear for m in heard.feed(desk.pty.read(0.05))),
            f"velocity {linear}",
        )

    address = f"wirebond://{desk.server.path}"
    with wirebond.open(desk.codec, address) as link, wirebond.open(desk.codec, address) as person:
        rover = cast(RoverProcess, NoRover())
        driving = threading.Thread(target=drive, args=(link, rover, time.monotonic() + 2 * PATIENCE))
        driving.start()
        wait_for_speed(0.8)
        owner = desk.server._owner
        owner.loop.call_soon_threadsafe(owner.end_control, "silent")
        wait_for_speed(0.0)
        wait_for_speed(0.8)
        person.take_control(over=True)
        wait_for_speed(0.0)
        driving.join(PATIENCE)
        assert not driving.is_alive()
        assert person.control.is_own
