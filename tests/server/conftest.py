"""A served link over a pty, and programs that attach to it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

import wirebond
from tests.patient_servers import ages, real_ages  # noqa: F401 - fixtures of this folder
from tests.shared import codec
from tests.waiting import moments, rounds_for, wait_until
from wirebond.server import Server
from wirebond.sim.pty_port import PtyPort

WRITER = Path(__file__).with_name("writer.py")


@dataclass
class Served:
    """A link to a pty whose other side the test reads, with its server."""

    codec: wirebond.Codec
    pty: PtyPort
    link: wirebond.Link
    server: Server
    address: str

    def __post_init__(self) -> None:
        self._decoder = self.codec.decoder("host")

    def attach(self) -> wirebond.Link:
        return wirebond.open(self.codec, self.address)

    def sent(self, wait: float = 0.0) -> list[wirebond.Message]:
        """Return the messages that left at the port since the last call: all that the link has accepted by now, and all
        that follow within ``wait`` seconds."""
        found: list[wirebond.Message] = []
        for _ in rounds_for(wait):
            found += self._decoder.feed(self.pty.read(0.005))
        for _ in moments("what the link has accepted does not leave"):
            stats = self.link.stats.send
            if not stats.queued and self._decoder.stats.frames >= stats.sent:
                return found
            found += self._decoder.feed(self.pty.read(0.005))
        raise AssertionError

    def sent_until(self, holds: Callable[[list[wirebond.Message]], object]) -> list[wirebond.Message]:
        """Return the messages that left at the port since the last call, until they are as wanted."""
        found: list[wirebond.Message] = []
        wait_until(lambda: holds(found) or found.extend(self.sent()), lambda: f"what is wanted; {found} left")
        return found


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    proto, pty = codec("diffdrive"), PtyPort()
    path = tmp_path / "server.sock"
    with wirebond.open(proto, pty.path) as link, Server(link, path, tcp=("127.0.0.1", 0)) as server:
        yield Served(proto, pty, link, server, f"wirebond://{path}")
    pty.close()


@dataclass
class Writer:
    """A program of its own that attaches and drives."""

    process: subprocess.Popen[str]

    def line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()


@pytest.fixture
def start_writer(served: Served) -> Iterator[Callable[..., Writer]]:
    started: list[subprocess.Popen[str]] = []

    def start(how: str, address: str | None = None) -> Writer:
        process = subprocess.Popen(
            [sys.executable, str(WRITER), address or served.address, how], stdout=subprocess.PIPE, text=True
        )
        started.append(process)
        writer = Writer(process)
        while (said := writer.line()) != "drives":
            assert said == "LateCommandError"  # the machine was slow
        return writer

    yield start
    for process in started:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()
