"""Listening to both directions of a line with two ports that only receive."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import wirebond
from tests.shared import ROOT, codec
from tests.waiting import PATIENCE, wait_until
from wirebond import PortError
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

ROVER = codec("diffdrive")
VELOCITY = ROVER.encode("velocity", linear=0.5, angular=0)
ODOMETRY = ROVER.encode("odometry", left_ticks=1, right_ticks=2)


@pytest.fixture
def taps() -> Iterator[tuple[PtyPort, PtyPort]]:
    """Yield the port of the host's bytes and that of the MCU's."""
    ports = PtyPort(), PtyPort()
    yield ports
    for port in ports:
        port.close()


def test_each_message_comes_with_its_sender_in_the_order_of_the_line(taps: tuple[PtyPort, PtyPort]) -> None:
    host, mcu = taps
    with wirebond.listen(ROVER, host_port=host.path, mcu_port=mcu.path) as line:
        got: list[wirebond.Heard] = []
        for _ in range(3):
            for tap, frame in ((host, VELOCITY), (mcu, ODOMETRY)):
                tap.write(frame)
                got += line.receive(PATIENCE)
        assert [(sender, message.name) for sender, message in got] == [("host", "velocity"), ("mcu", "odometry")] * 3
        assert line.receive(0.01) == []
        mcu.write(VELOCITY + ODOMETRY)  # an id that the MCU does not send
        names = [(h.sender, h.message.name) for h in line.receive(PATIENCE)]
        assert names[-1] == ("mcu", "odometry")
        assert ("mcu", "velocity") not in names
        assert [link.stats.send.offered for link in line.links.values()] == [0, 0]
    assert host.read(0) + mcu.read(0) == b""  # it said nothing


def test_nothing_is_said_where_the_file_maps_hello_and_clock(taps: tuple[PtyPort, PtyPort]) -> None:
    native = codec("native")
    host, mcu = taps
    with wirebond.listen(native, host_port=host.path, mcu_port=mcu.path) as line:
        host.write(native.encode("hello", protocol_hash=5, version=1, sender="host"))
        mcu.write(native.encode("hello", protocol_hash=5, version=1, sender="mcu"))
        wait_until(lambda: [link.peer.hash for link in line.links.values()] == [5, 5], "both hellos")
        assert {h.sender for h in line.receive(PATIENCE)} == {"host", "mcu"}
    assert host.read(0) + mcu.read(0) == b""


def test_a_loop_ends_when_it_is_closed(taps: tuple[PtyPort, PtyPort]) -> None:
    host, mcu = taps
    line = wirebond.listen(ROVER, host_port=host.path, mcu_port=mcu.path)
    heard: list[str] = []
    thread = threading.Thread(target=lambda: heard.extend(sender for sender, _ in line))
    thread.start()
    host.write(VELOCITY)
    wait_until(lambda: heard, "the velocity")
    line.close()
    thread.join(PATIENCE)
    assert (thread.is_alive(), heard) == (False, ["host"])


def test_the_first_port_is_given_back_where_the_second_is_not_there(taps: tuple[PtyPort, PtyPort]) -> None:
    host, _ = taps
    with pytest.raises(PortError, match="there is no port /dev/nowhere"):
        wirebond.listen(ROVER, host_port=host.path, mcu_port="/dev/nowhere")
    wirebond.open(ROVER, host.path).close()  # not busy


def test_the_command_prints_both(taps: tuple[PtyPort, PtyPort]) -> None:
    host, mcu = taps
    words = ["listen", str(ROOT / "protocols" / "diffdrive.yaml"), "--host-port", host.path, "--mcu-port", mcu.path]
    command = [str(Path(sys.executable).with_name("wirebond")), *words, "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        stop = threading.Event()

        def talk() -> None:
            while not stop.wait(0.02):
                host.write(VELOCITY)
                mcu.write(ODOMETRY)

        thread = threading.Thread(target=talk)
        thread.start()
        expected, found = {("host", "velocity"), ("mcu", "odometry")}, set[tuple[str, str]]()
        for line in itertools.islice(process.stdout, 2000):  # many of one end may have waited in its pty
            told = json.loads(line)
            found.add((told["from"], told["message"]))
            if found == expected:
                break
        stop.set()
        thread.join()
        process.terminate()
    assert found == expected
