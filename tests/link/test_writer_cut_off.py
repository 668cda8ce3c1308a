"""The writer of a schedule is stopped, killed or cut off: its value does not outlive `hold`, however that happens."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import wirebond
from tests.link.protocol import manipulator
from tests.shared import ROOT
from tests.suspended import Suspended
from tests.waiting import let_pass, moments, rounds_for, wait_until
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

HOLD = 0.3
FAST, SAFE = 1000, 0

WRITER = f"""
import sys, time
import wirebond
from tests.link.protocol import manipulator
link = wirebond.open(manipulator(), sys.argv[1])
link.repeat("drive", hold={HOLD}, speed={FAST}, turn=7)
link.repeat("lamp", hold=60, level=1)
print("ready", flush=True)
time.sleep(60)
"""


class Line:
    """The far end: the port at this path, and the speeds that it heard since it was plugged in."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.plug_in()

    def plug_in(self) -> None:
        self._port = PtyPort()
        self._path.symlink_to(self._port.path)
        self._decoder = manipulator().decoder("host")
        self.speeds: list[int] = []
        self.lamps = 0

    def unplug(self) -> None:
        self._path.unlink()
        self._port.close()

    def hear(self) -> bool:
        """Return whether anything came."""
        data = self._port.read(0.02)
        for message in self._decoder.feed(data):
            if message.name == "drive":
                self.speeds.append(message.fields["speed"])
            else:
                self.lamps += 1
        return bool(data)

    def hear_until(self, speed: int) -> None:
        for _ in moments(lambda: f"{speed} did not come, but {self.speeds}"):
            self.hear()
            if speed in self.speeds:
                return

    def hear_for(self, seconds: float) -> None:
        for _ in rounds_for(seconds):
            self.hear()


@pytest.fixture
def line(tmp_path: Path) -> Iterator[Line]:
    found = Line(tmp_path / "tty")
    yield found
    found.unplug()


@pytest.fixture
def writer(line: Line, tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """It has set its value once, and sleeps; the far end heard the value."""
    command = [sys.executable, "-c", WRITER, str(tmp_path / "tty")]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        line.hear_until(FAST)
        yield process
        process.kill()


def test_a_stopped_writer_that_goes_on_sends_the_safe_value(line: Line, writer: subprocess.Popen[str]) -> None:
    with Suspended(writer.pid):
        line.hear_for(HOLD + 0.1)
        had_left = len(line.speeds)  # also the safe value, where the lease ended before the signal
    line.hear_until(SAFE)
    line.hear_for(0.1)
    assert FAST not in line.speeds[had_left:]


def test_nothing_comes_of_a_writer_that_was_killed(line: Line, writer: subprocess.Popen[str]) -> None:
    writer.kill()
    writer.wait()
    while line.hear():  # what was in the driver
        pass
    line.speeds.clear()
    line.hear_for(0.1)
    assert not line.speeds


def test_a_writer_that_was_cut_off_sends_nothing_of_before(line: Line, writer: subprocess.Popen[str]) -> None:
    assert writer.poll() is None
    line.unplug()
    let_pass(HOLD + 0.1)
    line.plug_in()
    wait_until(lambda: line.hear() and line.lamps >= 5, "the lamp, whose lease goes on")
    assert FAST not in line.speeds


def test_a_writer_that_was_cut_off_for_a_moment_goes_on_within_its_lease(line: Line) -> None:
    with wirebond.open(manipulator(), line._path) as link:
        link.repeat("drive", hold=60, speed=FAST, turn=7)
        line.hear_until(FAST)
        line.unplug()
        line.plug_in()
        line.hear_until(FAST)
