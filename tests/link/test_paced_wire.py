"""The number of bytes in the port's driver, counted at the far end of a wire that carries a byte each byte time."""

from __future__ import annotations

import time

import pytest

from tests.link.drivers import ThreadDriver, VirtualDriver
from tests.link.protocol import manipulator
from wirebond.errors import QueueFullError

FRAME = {"drive": 10, "note": 111}


def bytes_before_the_stop(data: bytes, mark: int, stop: bytes) -> int:
    """Return how many bytes of the wire passed between the stop's call, when `mark` had passed, and its first byte."""
    return data.index(stop, mark) - mark


@pytest.mark.parametrize("baud", [9600, 115200, 921600])
@pytest.mark.parametrize("text", [b"", b"x" * 20, b"x" * 35, b"x" * 40, b"x" * 100, b"x" * 200])
@pytest.mark.parametrize("later_us", [0, 137, 4_999, 50_001])
def test_at_most_5_ms_of_line_or_one_frame_leaves_before_a_stop(baud: int, text: bytes, later_us: int) -> None:
    codec = manipulator()
    link = VirtualDriver(codec, baud=baud)
    stop = codec.encode("arm", torque=0)
    frame = codec.encode("note", number=0xFFFFFFFF, text=text)
    link.fill_queue("note", number=0xFFFFFFFF, text=text)
    link.run(later_us / 1e6)
    mark = len(link.arrived())
    link.emergency_stop()
    link.run(0.6 if baud == 9600 else 0.1)
    before = bytes_before_the_stop(link.arrived(), mark, stop)
    # 5 ms; or one frame, where it takes more than 4 ms, behind the last millisecond of the one that is leaving.
    longest_us = max(5_000, len(frame) * link.byte_us + 1_000)
    assert before * link.byte_us <= longest_us + link.byte_us  # the byte that is on the wire


@pytest.mark.parametrize("baud", [9600, 115200, 921600, 3_000_000])
@pytest.mark.parametrize("text", [b"", b"x" * 40, b"x" * 200])
def test_pacing_costs_no_throughput(baud: int, text: bytes) -> None:
    link = VirtualDriver(manipulator(), baud=baud)
    began = link.now
    idle = link.wire_idle_us
    while link.now - began < 2_000_000:
        try:
            link.send("note", number=1, text=text)
        except QueueFullError:
            link.run(0.01)
    assert link.wire_idle_us - idle <= 2 * link.byte_us  # before the first byte
    assert link.buffered * link.byte_us <= 6_000 + 220 * link.byte_us


def test_a_wire_slower_than_its_rate_does_not_fill_a_driver_that_reports_its_queue() -> None:
    codec = manipulator()
    link = VirtualDriver(codec, wire_baud=112_000)  # 2.8 % slower, as a UART's divider may be
    link.tells_what_it_holds = True
    began = link.now
    while link.now - began < 5_000_000:
        try:
            link.send("drive", speed=1, turn=1)
        except QueueFullError:
            link.run(0.01)
        assert link.buffered * link.byte_us <= 5_000 + 2 * 10 * link.byte_us


def test_a_port_that_is_not_paced_takes_what_it_takes() -> None:
    link = VirtualDriver(manipulator(), paced=False)
    link.fill_queue("drive", speed=1, turn=1)
    assert link.buffered == VirtualDriver.buffer_bytes


@pytest.mark.timed(tolerance=0.02)
def test_over_a_pty_a_stop_waits_for_milliseconds_of_line_not_for_a_full_driver() -> None:
    """A far end that reads in byte times."""
    codec = manipulator()
    stop = codec.encode("arm", torque=0)
    link = ThreadDriver(codec)
    try:
        link.fill_queue("drive", speed=1000, turn=7)
        link.run(0.05)
        mark = link.reader.count_at(time.monotonic())
        link.emergency_stop()
        link.run_until(lambda: stop in link.arrived(), "the stop arrives")
        link.run(0.1)
        data = link.arrived()
        after = codec.decoder("host").feed(data[data.index(stop) :])
        assert all(not any(message.fields.values()) for message in after)  # nothing older follows
        before = bytes_before_the_stop(data, mark, stop)
    finally:
        link.end()
    # 5 ms, the millisecond in which the far end reads, and the tolerance. The pty itself would take 16 KB, 1.4 s.
    assert before <= 58 + 12 + 0.02 * 11_520
