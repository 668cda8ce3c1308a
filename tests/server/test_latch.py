"""The emergency stop of a server: who may release it, and that it outlives the server."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import wirebond
from tests.link.protocol import manipulator
from tests.server.conftest import Served
from tests.shared import codec
from tests.waiting import PATIENCE, Stopwatch, wait_until
from wirebond.cli.main import main
from wirebond.errors import LateCommandError, NotInControlError, StoppedByOtherError, StoppedError
from wirebond.link.attached.address import socket_of
from wirebond.link.attached.words import Control
from wirebond.link.stop_file import StopFile
from wirebond.server import Server
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live


@contextmanager
def served_again(path: Path, proto: wirebond.Codec | None = None, role: str = "host") -> Iterator[Served]:
    proto, pty = proto or codec("diffdrive"), PtyPort()
    with wirebond.open(proto, pty.path, role=role) as link, Server(link, path) as server:
        yield Served(proto, pty, link, server, f"wirebond://{path}")
    pty.close()


def test_the_program_that_stopped_releases(served: Served) -> None:
    with served.attach() as link:
        link.emergency_stop()
        assert served.server.stopped_by == served.server.log.commands()[-1].name
        link.release_stop()
        assert served.server.stopped_by is None
        link.send("velocity", linear=0.5, angular=0.0)


def test_another_program_must_say_so_and_is_logged(served: Served, caplog: pytest.LogCaptureFixture) -> None:
    with served.attach() as stops, served.attach() as other:
        stops.emergency_stop()
        with pytest.raises(StoppedByOtherError, match=r"stopped the robot.*release_stop\(over=True\)") as refused:
            other.release_stop()
        assert refused.value.by == served.server.stopped_by
        assert stops.stopped
        other.release_stop(over=True)
        assert not stops.stopped
        released = [entry for entry in served.server.log.commands() if entry.do == "release_stop"]
        assert [entry.error for entry in released] == ["stopped_by_other", ""]
        [said] = [r for r in caplog.records if r.name == "wirebond.server" and r.levelno == logging.WARNING]
        assert said.getMessage() == f"{released[1].name} released the emergency stop by {refused.value.by}"


def test_of_two_programs_that_stopped_neither_releases_alone(served: Served) -> None:
    with served.attach() as first, served.attach() as second:
        first.emergency_stop()
        second.emergency_stop()
        for link in (first, second):
            with pytest.raises(StoppedByOtherError):
                link.release_stop()
        first.release_stop(over=True)
        assert not second.stopped


def test_a_program_that_sends_without_pause_does_not_win_by_chance(served: Served) -> None:
    with served.attach() as stops, served.attach() as hammers:
        stops.emergency_stop()
        with served.attach() as late:  # it attached while the robot was stopped
            for link in (hammers, late):
                with pytest.raises(StoppedError):
                    link.send("velocity", linear=0.5, angular=0.0)
            stops.release_stop()
            for link in (hammers, late):
                with pytest.raises(NotInControlError, match=r"take_control\("):
                    link.send("velocity", linear=0.5, angular=0.0)
        stops.send("velocity", linear=0.1, angular=0.0)


def test_a_program_that_took_control_while_the_stop_held_does_not_drive_at_its_release(served: Served) -> None:
    with served.attach() as stops, served.attach() as hammers:
        stops.emergency_stop()
        hammers.take_control()
        with pytest.raises(StoppedError):
            hammers.repeat("velocity", linear=0.5, angular=0.0)
        stops.release_stop()
        with pytest.raises(NotInControlError):
            hammers.repeat("velocity", linear=0.5, angular=0.0)
        assert served.server.holder is None


@pytest.mark.parametrize("releases", ["the one that stopped", "the owner of the link"])
def test_a_program_that_asks_in_a_loop_does_not_win_by_chance(served: Served, releases: str) -> None:
    with served.attach() as stops, served.attach() as hammers:
        stops.emergency_stop()
        ends = threading.Event()

        def hammer() -> None:
            while not ends.is_set():
                with contextlib.suppress(NotInControlError, StoppedError, LateCommandError):
                    hammers.take_control()
                    hammers.send("velocity", linear=1.0, angular=0.0)

        thread = threading.Thread(target=hammer)
        thread.start()
        wait_until(lambda: served.server.holder is not None, "it takes control while the stop holds")
        if releases == "the owner of the link":
            served.link.release_stop()
            name = "the program that owns the link"
        else:
            stops.release_stop()
            name = served.server.log.commands()[-1].name
        wait_until(lambda: stops.control.released_by is not None and hammers.control.released_by is not None)
        for _ in range(20):
            with pytest.raises(NotInControlError, match=re.escape(f"{name} released the emergency stop")):
                hammers.take_control()
        ends.set()
        thread.join()
        assert served.server.holder is None
        assert [m["linear"] for m in served.sent(0.1) if m.name == "velocity" and m["linear"]] == []
        if releases == "the owner of the link":
            with served.attach() as new:  # a program that a person starts now is not a loop
                new.send("velocity", linear=0.1, angular=0.0)
        else:
            stops.send("velocity", linear=0.1, angular=0.0)
            stops.release_control()
            hammers.take_control()  # somebody was in control since: the usual rules hold
            assert hammers.control.is_own


@pytest.mark.parametrize("over", ["name", "any"])
def test_another_program_takes_control_after_a_release_by_saying_so(served: Served, over: str) -> None:
    with served.attach() as stops, served.attach() as other:
        stops.emergency_stop()
        stops.release_stop()
        name = served.server.log.commands()[-1].name
        wait_until(lambda: other.control == Control(None, False, name))
        with pytest.raises(NotInControlError, match=re.escape(f"{name} released the emergency stop")):
            other.take_control(over="pad")
        other.take_control(over=name if over == "name" else True)
        other.send("velocity", linear=0.1, angular=0.0)
        assert other.control.released_by is None


def test_a_stop_is_released_over_the_program_that_is_named(served: Served) -> None:
    with served.attach() as stops, served.attach() as other:
        stops.emergency_stop()
        name = served.server.stopped_by
        assert name is not None
        with pytest.raises(StoppedByOtherError) as refused:
            other.release_stop(over="pad")
        assert refused.value.by == name
        assert stops.stopped
        other.release_stop(over=name)
        assert not stops.stopped


def test_a_release_by_the_owner_of_the_link_does_not_end_control_that_is_taken_after_it(served: Served) -> None:
    with served.attach() as driver:
        served.link.emergency_stop()
        wait_until(lambda: served.server.stopped_by is not None)
        stalled, goes_on = threading.Event(), threading.Event()
        served.server._owner.loop.call_soon_threadsafe(lambda: (stalled.set(), goes_on.wait(PATIENCE)))
        assert stalled.wait(PATIENCE)
        served.link.release_stop()  # which the server has not seen yet
        taking = threading.Thread(target=driver.take_control, kwargs={"over": True})
        taking.start()
        wait_until(lambda: len(driver.internals.engine._calls) > 0, "it is asked")  # type: ignore[union-attr]
        goes_on.set()
        taking.join()
        ticks = served.server._owner.book.ticks
        before = ticks.newest
        wait_until(lambda: ticks.newest > before + 1, "the server has looked again")
        driver.send("velocity", linear=0.1, angular=0.0)
        assert driver.control.is_own


def test_the_program_that_releases_keeps_the_control_that_it_took(served: Served) -> None:
    with served.attach() as link:
        link.emergency_stop()
        link.take_control()
        link.release_stop()
        link.send("velocity", linear=0.5, angular=0.0)


def test_a_stop_by_the_owner_of_the_link_ends_control_too(served: Served) -> None:
    with served.attach() as driver:
        driver.send("velocity", linear=0.5, angular=0.0)
        served.link.emergency_stop()
        wait_until(lambda: served.server.stopped_by is not None and served.server.holder is None)
        served.link.release_stop()
        wait_until(lambda: served.server.stopped_by is None)
        with pytest.raises(NotInControlError, match=r"take_control\("):
            driver.send("velocity", linear=0.5, angular=0.0)


def test_a_stop_ends_the_leases_of_messages_that_it_does_not_send(tmp_path: Path) -> None:
    with served_again(tmp_path / "robot.sock", manipulator()) as served, served.attach() as driver:
        driver.repeat("lamp", level=7, hold=60)  # moves, by its `every`, and is not in the emergency stop
        wait_until(lambda: any(m.name == "lamp" for m in served.sent()), "it is repeated")
        with served.attach() as other:
            other.emergency_stop()
        wait_until(lambda: served.server.holder is None)
        served.sent()
        assert [m.name for m in served.sent(0.2) if m.name == "lamp"] == []


def test_the_end_of_a_program_ends_its_leases_while_a_stop_holds(tmp_path: Path) -> None:
    with served_again(tmp_path / "robot.sock", manipulator()) as served:
        with served.attach() as driver:
            driver.emergency_stop()
            driver.take_control()
            driver.repeat("lamp", level=7, hold=60)
        served.sent()
        assert [m.name for m in served.sent(0.2) if m.name == "lamp"] == []


def test_the_stop_outlives_its_server(tmp_path: Path) -> None:
    path = tmp_path / "robot.sock"
    with served_again(path) as first, first.attach() as link:
        link.emergency_stop()
    with served_again(path) as second:
        wait_until(lambda: any(m.name == "velocity" and m["linear"] == 0.0 for m in second.sent()), "it is sent")
        assert second.server.stopped_by is not None
        with second.attach() as link:
            with pytest.raises(StoppedError):
                link.send("velocity", linear=0.5, angular=0.0)
            with pytest.raises(StoppedByOtherError):
                link.release_stop()
            link.release_stop(over=True)
    with served_again(path) as third:
        assert third.server.stopped_by is None


@pytest.mark.parametrize("text", ["", "{", "[]", '{"stopped_by": 3}', '{"stopped_by": "\\u0000"}', "[" * 100_000])
def test_a_file_that_cannot_be_read_is_a_stop(tmp_path: Path, text: str) -> None:
    path = tmp_path / "robot.sock"
    (tmp_path / "robot.sock.stop").write_text(text)
    with served_again(path) as served:
        assert served.link.stopped
        assert served.server.stopped_by == "a program that is not known any more"


@pytest.mark.parametrize("kind", ["fifo", "folder", "symlink", "huge"])
def test_any_file_of_that_name_is_a_stop_and_blocks_no_server(tmp_path: Path, kind: str) -> None:
    path, latch = tmp_path / "robot.sock", tmp_path / "robot.sock.stop"
    if kind == "fifo":
        os.mkfifo(latch)
    elif kind == "folder":
        latch.mkdir()
    elif kind == "symlink":
        latch.symlink_to("/dev/zero")
    else:
        latch.write_text('{"stopped_by": "pad"}' + " " * 100_000)
    with served_again(path) as served:
        assert served.link.stopped


def test_a_stop_that_still_holds_at_the_start_is_said_in_a_sentence(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "robot.sock"
    (tmp_path / "robot.sock.stop").write_text('{"stopped_by": "pad"}')
    with served_again(path):
        assert "the emergency stop by pad still holds, as before this server was started" in caplog.text


@pytest.mark.parametrize("why", ["no stop in the file", "the MCU's end"])
def test_a_server_that_cannot_hold_a_stop_says_so_and_leaves_it_to_the_next(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, why: str
) -> None:
    path = tmp_path / "robot.sock"
    (tmp_path / "robot.sock.stop").write_text('{"stopped_by": "pad"}')
    other = codec("diffdrive") if why == "the MCU's end" else wirebond.Codec(wirebond.protocol.loads(_WITHOUT_STOP))
    with served_again(path, other, role="mcu" if why == "the MCU's end" else "host"):
        assert "this server cannot hold it" in caplog.text
    with served_again(path) as served:
        assert served.server.stopped_by == "pad"


def test_a_server_that_is_killed_while_it_keeps_the_stop_leaves_it_latched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(*_: Any) -> None:
        raise SystemExit

    latch = StopFile(tmp_path / "stop")
    for step in ("ftruncate", "write"):
        (tmp_path / "stop").unlink(missing_ok=True)
        with monkeypatch.context() as patch:
            patch.setattr(os, step, killed)
            with pytest.raises(SystemExit):
                latch.write("pad")
        assert StopFile(tmp_path / "stop").read() is not None


def test_a_full_disk_keeps_the_stop_and_loses_only_the_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", full)
        StopFile(tmp_path / "stop").write("pad")
    assert "without the name" in caplog.text
    assert StopFile(tmp_path / "stop").read() == "a program that is not known any more"


def test_the_latch_follows_no_link_to_a_file_of_somebody_else(tmp_path: Path) -> None:
    theirs = tmp_path / "theirs"
    theirs.write_text("precious")
    (tmp_path / "stop").symlink_to(theirs)
    latch = StopFile(tmp_path / "stop")
    latch.write("pad")
    assert theirs.read_text() == "precious"
    latch.remove()
    assert theirs.exists()
    assert latch.read() is None


def test_a_stop_that_cannot_be_kept_holds_and_says_so(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "robot.sock"
    with served_again(path) as served, served.attach() as link:
        (tmp_path / "robot.sock.stop").mkdir()
        link.emergency_stop()
        assert link.stopped
        assert "would be forgotten if this program were restarted" in caplog.text


def test_a_client_that_stops_and_releases_without_pause_fills_no_log(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with served_again(tmp_path / "robot.sock") as served, served.attach() as link:
        (tmp_path / "robot.sock.stop").mkdir()
        watch = Stopwatch()
        for _ in range(300):
            link.emergency_stop()
            link.release_stop()
        said = [record for record in caplog.records if record.levelno >= logging.WARNING]
        assert 1 <= len(said) <= watch.seconds + 2
        with served.attach() as other:
            watch, before = Stopwatch(), len(caplog.records)
            for _ in range(300):
                link.emergency_stop()
                other.release_stop(over=True)
            assert len(caplog.records) - before <= 2 * (watch.seconds + 2)


def test_a_stop_by_the_owner_of_the_link_is_one_of_another_program(served: Served) -> None:
    with served.attach() as link:
        served.link.emergency_stop()
        with pytest.raises(StoppedByOtherError, match="the program that owns the link"):
            link.release_stop()
        served.link.release_stop()
        wait_until(lambda: served.server.stopped_by is None)


def test_a_second_server_at_the_path_sends_no_stop(served: Served) -> None:
    with served.attach() as stops:
        stops.emergency_stop()
        with wirebond.open(served.codec, "sim:") as link:
            with pytest.raises(wirebond.PortError, match="another server listens"):
                Server(link, served.server.path)
            assert not link.stopped


def test_the_command_stops_and_releases(served: Served, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["stop", served.address]) == 0
    assert served.link.stopped
    assert main(["stop", served.address, "--release"]) == 1
    assert "add --over" in capsys.readouterr().err
    assert served.link.stopped
    assert main(["stop", served.address, "--release", "--over"]) == 0
    assert not served.link.stopped
    assert main(["stop", served.address, "--release"]) == 0
    assert "no emergency stop is latched" in capsys.readouterr().err
    assert main(["stop", "/dev/ttyUSB0"]) == 2
    assert main(["stop", served.address, "--over"]) == 2


def test_serve_prints_that_the_stop_still_holds_and_who_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    latch = socket_of("rover").with_name("rover.sock.stop")
    latch.parent.mkdir(mode=0o700, parents=True)
    latch.write_text('{"stopped_by": "pad"}')
    file = codec("diffdrive").model.path
    assert main(["serve", file, "sim:", "--name", "rover", "--seconds", "0.5"]) == 0
    said = capsys.readouterr().err
    assert "the emergency stop by pad still holds, as before this server was started" in said
    assert "pad stopped the robot" in said
    assert latch.exists()


_WITHOUT_STOP = """
wirebond: 1
protocol: lamp
frame: [magic: 0xAA 0x55, id: u8, payload: 2, check: crc-16/modbus]
messages: {lamp: {id: 1, sender: host, fields: {level: {type: u16}}}}
"""
