"""Another program at the port of a link: it changes the settings, or reads what comes."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import termios
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import wirebond
from tests.shared import PROTOCOLS, codec
from tests.waiting import PATIENCE, moments, wait_until
from wirebond.analysis.diagnosis import Diagnosis, Kind
from wirebond.link.devices.processes import other_users
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

WIREBOND = Path(sys.executable).with_name("wirebond")
FRAME = codec("diffdrive").encode("odometry", left_ticks=3, right_ticks=-3)


@contextmanager
def linked() -> Iterator[tuple[PtyPort, wirebond.Link]]:
    pty = PtyPort()
    try:
        with wirebond.open(PROTOCOLS / "diffdrive.yaml", pty.path) as link:
            yield pty, link
    finally:
        pty.close()


@contextmanager
def another_program(pty: PtyPort, *command: str) -> Iterator[int]:
    """One that has the port open as its standard input; gives its number."""
    tty = os.open(pty.path, os.O_RDWR | os.O_NOCTTY)
    with subprocess.Popen(command, stdin=tty, stdout=subprocess.DEVNULL) as other:
        os.close(tty)
        try:
            yield other.pid
        finally:
            other.kill()


def shared_port(link: wirebond.Link) -> Diagnosis | None:
    return next((one for one in wirebond.diagnose(link) if one.kind == Kind.SHARED_PORT), None)


def evidence(link: wirebond.Link) -> str:
    found = shared_port(link)
    return "" if found is None else found.evidence


def make_cooked(tty: int) -> None:
    """As a shell has it."""
    settings = termios.tcgetattr(tty)
    settings[0] |= termios.ICRNL | termios.IXON
    settings[3] |= termios.ICANON | termios.ECHO
    termios.tcsetattr(tty, termios.TCSANOW, settings)


def test_settings_that_another_program_changes_are_put_back(tmp_path: Path) -> None:
    with linked() as (pty, link):
        tty = os.open(pty.path, os.O_RDWR | os.O_NOCTTY)
        before = termios.tcgetattr(tty)
        with link.record(tmp_path / "run.mcap"):
            for times in ("1 time;", "2 times;"):
                make_cooked(tty)
                for _ in moments("the link notices it"):
                    if evidence(link).startswith(times):
                        break
                assert termios.tcgetattr(tty) == before
        os.close(tty)
        pty.write(FRAME)
        assert [message.name for message in link.receive(timeout=PATIENCE)] == ["odometry"]
    events = wirebond.recording.open(tmp_path / "run.mcap").events
    assert [event.kind for event in events].count("port_settings") == 2


def test_a_program_that_takes_bytes_away_is_named() -> None:
    with linked() as (pty, link):
        with another_program(pty, "cat") as other:
            halves = itertools.cycle((FRAME[:5], FRAME[5:]))  # a whole frame that is taken leaves no trace
            for _ in moments("the diagnosis names it"):
                pty.write(next(halves))
                found = shared_port(link)
                if found is not None:
                    break
            assert found.evidence == f"cat (process {other}) has {pty.path} open"
        assert other_users(pty.path) == []


def test_a_link_that_opens_a_port_names_who_has_it_open(caplog: pytest.LogCaptureFixture) -> None:
    pty = PtyPort()
    with another_program(pty, "sleep", "1000") as other, wirebond.open(PROTOCOLS / "diffdrive.yaml", pty.path):
        pass
    pty.close()
    assert f"{pty.path} is open in another program as well, sleep (process {other})" in caplog.text


def test_a_command_prints_who_has_its_port_open() -> None:
    pty = PtyPort()
    command = [WIREBOND, "monitor", PROTOCOLS / "diffdrive.yaml", pty.path, "--seconds", "0.1"]
    with another_program(pty, "sleep", "1000") as other:
        result = subprocess.run(command, check=False, capture_output=True, text=True)
    pty.close()
    assert result.returncode == 0
    said = " ".join(result.stderr.split())
    assert f"{pty.path} is open in another program as well, sleep (process {other}), and each byte" in said


def test_a_healthy_line_is_accused_of_nothing_although_another_program_has_it_open() -> None:
    with linked() as (pty, link), another_program(pty, "sleep", "1000") as other:
        assert [one.pid for one in other_users(pty.path)] == [other]
        for _ in range(20):
            pty.write(FRAME)
            link.receive(timeout=PATIENCE)
        assert wirebond.diagnose(link) == []


def test_the_other_end_of_a_pty_is_no_other_user(tmp_path: Path) -> None:
    link = tmp_path / "mcu"
    command = [WIREBOND, "sim", PROTOCOLS / "diffdrive.yaml", "--link", link]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as simulator:
        wait_until(link.exists, "the simulator is there")
        assert other_users(str(link)) == []
        simulator.terminate()
