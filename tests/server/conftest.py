"""A served link over a pty, and programs that attach to it."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

import wirebond
from tests.shared import PATIENCE, codec
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

    def attach(self) -> wirebond.Link:
        return wirebond.open(self.codec, self.address)

    def sent(self, wait: float = 0.0) -> list[wirebond.Message]:
        """What left at the port since the last call."""
        decoder = self.codec.decoder("host")
        end = time.monotonic() + wait
        found = decoder.feed(self.pty.read(0))
        while time.monotonic() < end:
            found += decoder.feed(self.pty.read(0.005))
        return found


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    proto, pty = codec("diffdrive"), PtyPort()
    path = tmp_path / "server.sock"
    with wirebond.open(proto, pty.path) as link, Server(link, path, tcp=("127.0.0.1", 0)) as server:
        yield Served(proto, pty, link, server, f"wirebond://{path}")
    pty.close()


def wait_until(holds: Callable[[], object], what: str = "it") -> None:
    end = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < end, what
        time.sleep(0.002)


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
        assert writer.line() == "drives"
        return writer

    yield start
    for process in started:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()
