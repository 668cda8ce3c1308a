"""An emergency stop where stops fall due faster than the line carries them, and while the link closes."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

import wirebond
from tests.link.drivers import PythonDriver, ThreadDriver, VirtualDriver
from tests.link.protocol import manipulator
from tests.waiting import PATIENCE
from wirebond.errors import LinkDownError
from wirebond.protocol import loads
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

ROOT = Path(__file__).resolve().parents[2]
FULL_SPEED = {"speed": 1000, "turn": 7}
SAFE = ("drive", {"speed": 0, "turn": 0})
JOINTS = [f"joint_{i}" for i in range(60)]

# At 9600 baud a frame of `arm` takes 69 ms, and is due every 50 ms.
HEAVY = f"""
wirebond: 1
protocol: heavy
link: {{baud: 9600}}
frame: [magic: 0xAA 0x55, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
messages:
  arm:   {{id: 1, sender: host, every: 50 ms, fields: {{{", ".join(f"{joint}: {{type: u8}}" for joint in JOINTS)}}}}}
  base:  {{id: 2, sender: host, every: 50 ms, fields: {{speed: {{type: i16}}}}}}
  wheel: {{id: 3, sender: host, every: 50 ms, fields: {{speed: {{type: i16}}}}}}
emergency_stop:
  - {{message: arm, {", ".join(f"{joint}: 0" for joint in JOINTS)}}}
  - {{message: base, speed: 0}}
  - {{message: wheel, speed: 0}}
"""


def _again_and_again(link: VirtualDriver) -> None:
    for _ in range(2_000):
        link.emergency_stop()
        link.run(0.001)


def _with_releases(link: VirtualDriver) -> None:
    for _ in range(2_000):
        link.emergency_stop()
        link.release_stop()
        link.run(0.001)


def _once(link: VirtualDriver) -> None:
    link.emergency_stop()
    link.run(2.0)


@pytest.mark.parametrize("press", [_once, _again_and_again, _with_releases])
def test_each_message_of_a_stop_gets_its_turn_where_the_line_is_too_slow(
    press: Callable[[VirtualDriver], None],
) -> None:
    link = VirtualDriver(wirebond.Codec(loads(HEAVY)), baud=9600)
    link.repeat("base", hold=60, speed=1000)
    link.run(0.2)
    before = len(link.messages())
    press(link)
    after = link.messages()[before:]
    names = [name for name, fields in after if not any(fields.values())]
    assert names[:3] == ["arm", "base", "wheel"]  # in the file's order
    assert min(names.count(name) for name in ("arm", "base", "wheel")) >= 20
    assert len(after) - len(names) <= 1  # one frame was under way


@pytest.mark.parametrize("driver", [ThreadDriver, PythonDriver])
def test_a_stop_while_the_link_closes_still_leaves_before_all_that_is_queued(
    driver: type[ThreadDriver],
) -> None:
    link = driver(manipulator())
    try:
        assert link.fill_queue("drive", **FULL_SPEED) > 1000  # more than a second of line
        link.link.hand_over()  # else the close itself sends the safe value, and drops them
        closing = threading.Thread(target=link.link.close)
        closing.start()
        link.run_until(lambda: "closed" in repr(link.link), "the link begins to close")
        link.emergency_stop()
        closing.join(PATIENCE)
        assert not closing.is_alive()
        link.reader.settle(link.stats()["send"]["sent_bytes"])
        assert link.messages()[-1] == SAFE
        with pytest.raises(LinkDownError, match="was not sent"):
            link.emergency_stop()
        stats = link.stats()["send"]
        assert stats["queued"] == 0
        assert stats["overruled"] > 100
        link.check()
    finally:
        link.end()


@pytest.mark.parametrize("driver", [ThreadDriver, PythonDriver])
def test_each_of_two_closes_waits_until_the_port_is_given_back(
    driver: type[ThreadDriver],
) -> None:
    link = driver(manipulator())
    try:
        link.fill_queue("drive", **FULL_SPEED)
        queued: list[int] = []

        def close() -> None:
            link.link.close()
            queued.append(link.stats()["send"]["queued"])

        threads = [threading.Thread(target=close) for _ in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(PATIENCE)
        assert queued == [0] * 8
    finally:
        link.end()


# The exit handlers of a program run in the order in which they were registered, the last one first.
SEVERAL = """
import atexit, sys, time

def look():
    after = [link.stats.send for link in links]
    print(sum(a.offered - b for a, b in zip(after, before)), [send.queued for send in after])

atexit.register(look)
import wirebond
from tests.link.protocol import manipulator

links = [wirebond.open(manipulator(), path) for path in sys.argv[1:]]
for link in links:
    try:
        while True:
            link.send("note", number=1, text=bytes(200))
    except wirebond.QueueFullError:
        link.repeat("drive", hold=60, speed=1000, turn=7)

@atexit.register
def begin():
    global before
    before = [link.stats.send.offered for link in links]
"""


def test_at_the_end_of_a_program_every_link_stops_repeating_before_any_waits() -> None:
    """One after the other they would wait for a second each, while the others drive on."""
    ports = [PtyPort() for _ in range(5)]  # nobody reads: each close takes its second
    try:
        result = subprocess.run(
            [sys.executable, "-c", SEVERAL, *(port.path for port in ports)],
            capture_output=True,
            text=True,
            check=False,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            timeout=PATIENCE,
        )
    finally:
        for port in ports:
            port.close()
    assert result.returncode == 0, result.stderr
    offered, queued = result.stdout.split(maxsplit=1)
    assert queued.strip() == str([0] * 5)
    assert 5 <= int(offered) < 100  # a safe value each; driving on would be 500
