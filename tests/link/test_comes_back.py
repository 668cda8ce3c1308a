"""A link under load whose port goes away and comes back, again and again: unplugged, renamed, its peer restarted."""

from __future__ import annotations

import contextlib
import random
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Self

import pytest

import wirebond
import wirebond.link.settings
from tests.link.protocol import manipulator, without_deadlines
from tests.shared import account_closes, few_or_many
from tests.waiting import let_pass, wait_until
from wirebond import LinkDownError, PortError, QueueFullError
from wirebond.link import python_link, python_ports
from wirebond.sim.pty_port import PtyPort

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("ports")]


class Device:
    """An MCU behind a USB adapter: it sends ``pose`` all the time, and notes the numbers of the notes that it hears."""

    def __init__(self) -> None:
        self._codec = manipulator()
        self._pose = self._codec.encode("pose", x=1)
        self._lock = threading.Lock()
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.port: PtyPort | None = None
        self.heard: list[int] = []

    def start(self) -> None:
        self._thread.start()

    def plug_in(self) -> str:
        """The path at which it is now: another pty each time, so that nothing of before is in it."""
        with self._lock:
            self._decoder = self._codec.decoder("host")
            self.heard = []
            self.port = PtyPort()
            return self.port.path

    def unplug(self) -> None:
        with self._lock:
            port, self.port = self.port, None
            if port is not None:
                port.close()

    def restart(self) -> None:
        """The MCU begins again, and the adapter keeps its power: the port stays, and half a frame was on the line."""
        with self._lock:
            assert self.port is not None
            self.port.write(self._pose[:5])
            self._decoder = self._codec.decoder("host")
            self.heard = []

    def end(self) -> None:
        self._ends.set()
        self._thread.join()
        self.unplug()

    def _run(self) -> None:
        while not self._ends.wait(0.001):
            with self._lock:
                if self.port is None:
                    continue
                self.port.write(self._pose)
                notes = self._decoder.feed(self.port.read(0))
                self.heard += [note.fields["number"] for note in notes if note.name == "note"]


@pytest.fixture
def device() -> Iterator[Device]:
    found = Device()
    yield found
    found.end()


class Writer:
    """A program that sends numbered notes as fast as it is let, and takes what comes."""

    def __init__(self, link: wirebond.Link) -> None:
        self._link = link
        self._ends = threading.Event()
        self.number = 0  #: of the newest note that was tried
        self.poses = 0
        self._threads = [threading.Thread(target=run) for run in (self._send, self._take)]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        for thread in self._threads:
            thread.join()

    def _send(self) -> None:
        while not self._ends.wait(0.0005):
            self.number += 1
            try:
                self._link.send("note", number=self.number, text=b"x" * 100)
            except (LinkDownError, QueueFullError):
                continue

    def _take(self) -> None:
        while not self._ends.is_set():
            self.poses += len(self._link.receive(0.02))


@few_or_many(8, 200)
def test_it_always_comes_back_and_sends_nothing_of_before(
    number: int, device: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = random.Random(number)
    name = [tmp_path / "ttyUSB0"]  # where the device is; another one when it was renamed

    def find(_: str) -> str:
        if not name[0].is_symlink():
            raise PortError("no USB serial port is usb:1a86:55d3 at the moment; plug it in")
        return str(name[0])

    monkeypatch.setattr("wirebond.link.devices.port_name.resolve", find)
    name[0].symlink_to(device.plug_in())
    device.start()
    away = 0
    opened = wirebond.open(without_deadlines(), "usb:1a86:55d3", 2_000_000)
    with opened as link, Writer(link) as writer:
        for event in range(number):
            wait(lambda: len(device.heard) > 5 and link.state == "up", link, event)
            kind = source.choice(["unplug", "rename", "restart"])
            if kind == "restart":
                poses = writer.poses
                device.restart()
                let_pass(source.uniform(0, 0.02))
                wait(lambda poses=poses: device.heard and writer.poses > poses, link, event)
                continue
            away += 1
            name[0].unlink()
            device.unplug()
            wait(lambda: link.state == "down", link, event)
            before = writer.number
            let_pass(source.uniform(0, 0.1))
            if kind == "rename":
                name[0] = tmp_path / f"ttyUSB{event + 1}"
            name[0].symlink_to(device.plug_in())
            poses = writer.poses
            wait(lambda poses=poses: len(device.heard) > 0 and writer.poses > poses, link, event)
            assert min(device.heard) > before, (kind, event)
    stats = link.stats
    assert stats.reconnects == away > 0
    assert account_closes(stats.receive)
    send = stats.send
    assert send.offered == send.accepted + send.refused_down + send.refused_full + send.refused_stopped
    assert send.accepted == send.sent + send.replaced + send.expired + send.overruled + send.aborted


def wait(holds: Callable[[], bool], link: wirebond.Link, event: int) -> None:
    wait_until(holds, lambda: f"event {event}: {link!r} {link.why}")


def test_the_process_keeps_no_descriptor_of_a_port_that_went_away(tmp_path: Path) -> None:
    name = tmp_path / "tty"
    with wirebond.open(manipulator(), name, wait_for_port=True) as link:
        for event in range(6):
            port = PtyPort()
            assert descriptors_of(port.path) == 1  # the port's own
            name.symlink_to(port.path)
            wait(lambda path=port.path: link.state != "down" and descriptors_of(path) == 2, link, event)
            name.unlink()
            port.close()
            wait(lambda path=port.path: link.state == "down" and descriptors_of(path) == 0, link, event)


@pytest.mark.parametrize("moment", ["while it is tried", "before the loss shows"])
def test_a_device_that_appears_at_the_worst_moment_is_noticed(
    moment: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No further try comes by itself here: the notice alone brings the port back. The engine's own notice has its test
    in ports/posix/tests/appearance_test.cpp."""
    monkeypatch.setattr(wirebond.link.settings, "HAS_ENGINE_PORTS", False)
    for name in ("_FIRST_OPEN_WAIT", "_LAST_OPEN_WAIT", "_LAST_WATCHED_WAIT"):
        monkeypatch.setattr(python_link, name, 3600.0)
    port, name = PtyPort(), tmp_path / "tty"
    if moment == "before the loss shows":
        before = PtyPort()
        name.symlink_to(before.path)
        with wirebond.open(manipulator(), name) as link:
            (tmp_path / "new").symlink_to(port.path)
            (tmp_path / "new").rename(name)
            before.close()
            wait(lambda: descriptors_of(port.path) == 2, link, 0)
    else:
        opens = python_ports.PythonOpener.open

        def open_and_appear(self: python_ports.PythonOpener) -> python_ports.PythonPort:
            try:
                return opens(self)
            except PortError:
                with contextlib.suppress(FileExistsError):
                    name.symlink_to(port.path)
                raise

        monkeypatch.setattr(python_ports.PythonOpener, "open", open_and_appear)
        with wirebond.open(manipulator(), name, wait_for_port=True) as link:
            wait(lambda: descriptors_of(port.path) == 2, link, 0)
    port.close()


def descriptors_of(path: str) -> int:
    """Return how many descriptors of this process lead to it."""
    found = 0
    for descriptor in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):  # it was closed meanwhile
            found += str(descriptor.readlink()).removesuffix(" (deleted)") == path
    return found
