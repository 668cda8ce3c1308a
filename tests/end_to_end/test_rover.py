"""The simulated rover through its tty: driven by a host process that is then killed, or stopped in mid-schedule.

Times are read from the rover's own clock and from the order of its events; no bound here depends on a fast machine.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median

import pytest

import wirebond
from tests.shared import PATIENCE, PROTOCOLS
from wirebond.sim import rover

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
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return rover.build(tmp_path_factory.mktemp("rover"))


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


def wait_for_event(process: rover.RoverProcess, name: str) -> float:
    """The rover's own time of its next event of this name; what it reports before is passed over."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        for line in process.events(timeout=0.2):
            when, _, what = line.partition(" ")
            if what == name:
                return float(when)
    raise AssertionError(f"the rover never reported {name}")


def watch(port: str, seconds: float) -> list[wirebond.Message]:
    """What anybody sees who opens the tty and says nothing but status queries."""
    messages = []
    with wirebond.open(DIFFDRIVE, port) as link:
        link.send("status_query")
        end = time.monotonic() + seconds
        while time.monotonic() < end:
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
        time.sleep(1.5)  # it drives; what the rover reported before the host came is passed over
        process.events()
        host.send_signal(loss)
        if loss == signal.SIGKILL:
            assert host.wait(PATIENCE) == -signal.SIGKILL
        stopped = wait_for_event(process, "stop")
        safe = wait_for_event(process, "safe_mode")
    # Both count from the last velocity, by the rover's clock: the second strikes 2 s after the first.
    assert safe - stopped == pytest.approx(2.0, abs=0.5)
    seen = watch(process.port, 0.5)
    assert ticks(seen)
    assert set(ticks(seen)) == {0}
    (status,) = [m for m in seen if m.name == "status"]
    assert "comm_timeout" in status.fields["errors"]


def test_silence_is_measured_from_the_last_velocity(process: rover.RoverProcess) -> None:
    with wirebond.open(DIFFDRIVE, process.port) as link:
        link.send("parameter", name="clear_safe_mode", value=0)
        process.events()
        in_time, sent = 0, time.monotonic()
        while in_time < 8:  # 2 s of driving at a slow rhythm: no deadline may strike in between
            link.send("velocity", linear=0.2, angular=0.0)
            time.sleep(0.25)
            stops = [e for e in process.events() if e.endswith(" stop")]
            before, sent = sent, time.monotonic()
            in_time = in_time + 1 if sent - before < 0.5 else 0  # or this process was held up
            assert in_time == 0 or stops == []
        wait_for_event(process, "stop")


def test_rover_drives_what_it_is_told_and_safe_mode_needs_its_parameter(process: rover.RoverProcess) -> None:
    with wirebond.open(DIFFDRIVE, process.port) as link:
        wait_for_event(process, "safe_mode")  # nobody spoke since start-up: that holds nothing back
        link.receive()
        assert ticks(drive(link, linear=0.5, angular=0.0, odometry=20))[-1] > 0
        wait_for_event(process, "safe_mode")  # silence after a command does
        link.receive()
        assert set(ticks(drive(link, linear=0.5, angular=0.0, odometry=20))) == {0}

        link.send("parameter", name="clear_safe_mode", value=0)
        messages = drive(link, linear=0.5, angular=0.0, odometry=30)
        assert median(ticks(messages)[10:]) == pytest.approx(0.5 * 0.05 * 1024 / (3.14159 * 0.065), rel=0.3)
        messages = drive(link, linear=0.0, angular=1.0, odometry=30)
        assert messages[-1].fields["left_ticks"] < 0 < messages[-1].fields["right_ticks"]


def test_e_stop_stands_above_commands_and_shows_in_the_status(process: rover.RoverProcess) -> None:
    with wirebond.open(DIFFDRIVE, process.port) as link:
        link.send("parameter", name="clear_safe_mode", value=0)
        assert ticks(drive(link, linear=0.5, angular=0.0, odometry=20))[-1] > 0
        process.tell("estop on")
        assert ticks(drive(link, linear=0.5, angular=0.0, odometry=40))[-1] == 0
        assert status(link).fields["state"] == ["estop"]
        process.tell("estop off")
        assert ticks(drive(link, linear=0.5, angular=0.0, odometry=40))[-1] > 0
        assert status(link).fields["state"] == []


def test_motors_stand_still_before_the_first_command(process: rover.RoverProcess) -> None:
    with wirebond.open(DIFFDRIVE, process.port) as link:
        assert set(ticks(collect(link, 10))) == {0}


def collect(link: wirebond.Link, odometry: int) -> list[wirebond.Message]:
    messages: list[wirebond.Message] = []
    end = time.monotonic() + PATIENCE
    while len(messages) < odometry:
        assert time.monotonic() < end, "no odometry"
        messages += [m for m in link.receive(0.1) if m.name == "odometry"]
    return messages


def drive(link: wirebond.Link, linear: float, angular: float, odometry: int) -> list[wirebond.Message]:
    """Command it until this many odometry messages have come."""
    messages: list[wirebond.Message] = []
    end = time.monotonic() + PATIENCE
    while len(messages) < odometry:
        assert time.monotonic() < end, "no odometry"
        link.repeat("velocity", linear=linear, angular=angular)
        messages += [m for m in link.receive(0.05) if m.name == "odometry"]
    return messages


def status(link: wirebond.Link) -> wirebond.Message:
    link.send("status_query")
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        for message in link.receive(0.1):
            if message.name == "status":
                return message
    raise AssertionError("no status came")
