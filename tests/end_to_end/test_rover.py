"""The simulated rover through its tty: driven by a host process that is then killed, or stopped in mid-schedule.

When its deadlines strike is proved in virtual time, by test_lockstep.py.
"""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import dropwhile
from pathlib import Path
from statistics import median

import pytest

import wirebond
from tests.shared import PROTOCOLS, rover_program
from tests.waiting import PATIENCE, let_pass, moments, rounds_for, wait_until
from wirebond.sim import rover

pytestmark = pytest.mark.live

DIFFDRIVE = PROTOCOLS / "diffdrive.yaml"

HOST = """
import sys, time, wirebond
with wirebond.open(sys.argv[1], sys.argv[2]) as link:
    link.send("parameter", name="clear_safe_mode", value=0)
    print("driving", flush=True)
    while True:
        link.repeat("velocity", linear=0.5, angular=0.0)
        link.receive(0.05)
"""


@pytest.fixture(scope="module")
def program() -> Path:
    return rover_program()


@pytest.fixture
def process(program: Path) -> Iterator[rover.RoverProcess]:
    with rover.RoverProcess(program) as running:
        yield running


@contextmanager
def driving_host(port: str) -> Iterator[subprocess.Popen[str]]:
    """A program that keeps the rover driving, in a process of its own."""
    host = subprocess.Popen([sys.executable, "-c", HOST, str(DIFFDRIVE), port], stdout=subprocess.PIPE, text=True)
    try:
        assert host.stdout is not None
        assert host.stdout.readline().strip() == "driving"
        yield host
    finally:
        host.kill()
        host.wait()


def wait_for_event(process: rover.RoverProcess, name: str) -> list[str]:
    """Return the rover's reports, up to this one."""
    events: list[str] = []
    wait_until(
        lambda: name in events or events.extend(line.partition(" ")[2] for line in process.events(timeout=0.2)),
        lambda: f"the event {name} of the rover; there were {events}",
    )
    return events


def watch(port: str, seconds: float) -> list[wirebond.Message]:
    """Return what a program receives that opens the tty and sends only status queries: odometry for so long, and a
    status."""
    messages = []
    with wirebond.open(DIFFDRIVE, port) as link:
        link.send("status_query")
        for _ in rounds_for(seconds):
            messages += link.receive(0.05)
        for _ in moments("odometry and a status"):
            if {"odometry", "status"} <= {m.name for m in messages}:
                break
            messages += link.receive(0.05)
    return messages


def ticks(messages: list[wirebond.Message]) -> list[int]:
    return [m.fields["left_ticks"] for m in messages if m.name == "odometry"]


@pytest.mark.parametrize(
    "loss", [signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.long)], ids=["killed", "stopped"]
)
def test_rover_that_loses_its_host_stops_after_1_s_and_is_safe_after_3_s(
    process: rover.RoverProcess, loss: signal.Signals
) -> None:
    with driving_host(process.port) as host:
        process.events()  # what the rover reported before the host came is passed over
        let_pass(1.5)  # it drives
        host.send_signal(loss)
        if loss == signal.SIGKILL:
            assert host.wait(PATIENCE) == -signal.SIGKILL
        # When they strike: tests/end_to_end/test_lockstep.py, in virtual time.
        assert "stop" in wait_for_event(process, "safe_mode")
    seen = watch(process.port, 0.5)
    at_rest = list(dropwhile(bool, ticks(seen)))  # a first one may be of the moment before: both strike behind a pause
    assert len(at_rest) >= len(ticks(seen)) - 1 and at_rest
    assert set(at_rest) == {0}
    (status,) = [m for m in seen if m.name == "status"]
    assert "comm_timeout" in status.fields["errors"]


def test_rover_drives_as_commanded_and_safe_mode_needs_its_parameter(process: rover.RoverProcess) -> None:
    with wirebond.open(DIFFDRIVE, process.port) as link:
        wait_for_event(process, "safe_mode")  # nobody spoke since start-up: that holds nothing back
        link.receive()
        drive(link, 0.5, 0.0, lambda came: ticks(came)[-1] > 0, clears=False)
        link.stop_repeating("velocity")
        wait_for_event(process, "safe_mode")  # silence after a command does
        link.receive()
        assert set(ticks(drive(link, 0.5, 0.0, lambda came: len(came) >= 20, clears=False))) == {0}

        speed = pytest.approx(0.5 * 0.05 * 1024 / (3.14159 * 0.065), rel=0.3)
        drive(link, 0.5, 0.0, lambda came: median(ticks(came)[-20:]) == speed)
        drive(link, 0.0, 1.0, lambda came: came[-1].fields["left_ticks"] < 0 < came[-1].fields["right_ticks"])


def test_e_stop_overrules_commands_and_shows_in_the_status(process: rover.RoverProcess) -> None:
    with wirebond.open(DIFFDRIVE, process.port) as link:
        drive(link, 0.5, 0.0, lambda came: ticks(came)[-1] > 0)
        process.tell("estop on")
        drive(link, 0.5, 0.0, lambda came: len(came) >= 10 and set(ticks(came)[-10:]) == {0})
        assert set(ticks(drive(link, 0.5, 0.0, lambda came: len(came) >= 20))) == {0}
        assert status(link).fields["state"] == ["estop"]
        process.tell("estop off")
        drive(link, 0.5, 0.0, lambda came: ticks(came)[-1] > 0)
        assert status(link).fields["state"] == []


def test_motors_stand_still_before_the_first_command(process: rover.RoverProcess) -> None:
    with wirebond.open(DIFFDRIVE, process.port) as link:
        assert set(ticks(collect(link, 10))) == {0}


def collect(link: wirebond.Link, odometry: int) -> list[wirebond.Message]:
    messages: list[wirebond.Message] = []
    wait_until(
        lambda: len(messages) >= odometry or messages.extend(m for m in link.receive(0.1) if m.name == "odometry"),
        "odometry",
    )
    return messages


def drive(
    link: wirebond.Link,
    linear: float,
    angular: float,
    until: Callable[[list[wirebond.Message]], object],
    clears: bool = True,
) -> list[wirebond.Message]:
    """Command it until its odometry is so. ``clears``: end its safe mode, which a pause of the machine begins, too."""
    messages: list[wirebond.Message] = []

    def is_so() -> object:
        if clears:
            link.send("parameter", name="clear_safe_mode", value=0)
        link.repeat("velocity", linear=linear, angular=angular, hold=60)
        messages.extend(m for m in link.receive(0.05) if m.name == "odometry")
        return messages and until(messages)

    wait_until(is_so, lambda: f"the odometry that is wanted; the left wheel's ticks are {ticks(messages)[-20:]}")
    return messages


def status(link: wirebond.Link) -> wirebond.Message:
    return link.request("status_query", timeout=PATIENCE)
