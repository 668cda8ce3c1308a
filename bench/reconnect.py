"""Measures how long a link takes to come back: from the appearance of the device's node to the first message of its
peer.

The peer sends at 1 kHz. The link has a program under load above it: it sends and takes messages all the time. Between
two appearances the port is away for a moment, or so long that the link looks for it once in a second only.
"""

from __future__ import annotations

import random
import tempfile
import threading
import time
from pathlib import Path

import wirebond
from bench.collateral import PROTOCOL
from bench.figures import Figure
from wirebond.sim.pty_port import PtyPort

EVENTS = 200
LONG_AWAY = 2.5  # seconds; one event in ten
COMMAND = "make bench ONLY=reconnect"
GOAL = 250.0


class _Peer:
    """Sends one message every millisecond to whoever has its pty open."""

    def __init__(self, frame: bytes) -> None:
        self._frame = frame
        self._lock = threading.Lock()
        self._ends = threading.Event()
        self._port: PtyPort | None = None
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def plug_in(self) -> str:
        port = PtyPort()
        with self._lock:
            self._port = port
        return port.path

    def unplug(self) -> None:
        with self._lock:
            port, self._port = self._port, None
        if port is not None:
            port.close()

    def end(self) -> None:
        self._ends.set()
        self._thread.join()
        self.unplug()

    def _run(self) -> None:
        while not self._ends.wait(0.001):
            with self._lock:
                if self._port is not None:
                    self._port.write(self._frame)
                    self._port.read(0)


def measure(events: int = EVENTS) -> list[Figure]:
    times = sorted(came_back(events))
    return [
        Figure("reconnect_ms_max", times[-1], "ms", GOAL, COMMAND),
        Figure("reconnect_ms_p50", times[len(times) // 2], "ms", None, COMMAND),
    ]


def came_back(events: int) -> list[float]:
    """Milliseconds of each event."""
    source = random.Random(1)
    codec = wirebond.load(PROTOCOL)
    peer = _Peer(codec.encode("chassis_msg", x_vel=1, y_vel=2, w_vel=3))
    times = []
    with tempfile.TemporaryDirectory() as folder:
        node = Path(folder) / "ttyUSB0"
        node.symlink_to(peer.plug_in())
        with wirebond.open(codec, node) as link:
            ends = threading.Event()
            sender = threading.Thread(target=_send, args=(link, ends))
            sender.start()
            _first_after(link, 0.0)
            for _ in range(events):
                node.unlink()
                peer.unplug()
                while link.state != "down":
                    time.sleep(0.001)
                time.sleep(LONG_AWAY if source.random() < 0.1 else source.uniform(0, 0.2))
                path = peer.plug_in()
                appeared = time.monotonic()
                node.symlink_to(path)
                times.append((_first_after(link, appeared) - appeared) * 1000)
            ends.set()
            sender.join()
    peer.end()
    return times


def _first_after(link: wirebond.Link, since: float) -> float:
    while True:
        for message in link.receive(10):
            if message.t >= since:
                return message.t


def _send(link: wirebond.Link, ends: threading.Event) -> None:
    while not ends.wait(0.001):
        try:
            link.send("chassis_cmd", x_vel=1, y_vel=2, w_vel=3)
        except (wirebond.LinkDownError, wirebond.QueueFullError):
            continue
