"""Marks on a line of time: when deadlines at the MCU struck, and when bytes were discarded."""

from __future__ import annotations

from typing import Any

import pytest

from tests.shared import codec
from wirebond.protocol.model import End
from wirebond.recording.history.marks import Marks
from wirebond.recording.history.source import Source

DIFFDRIVE = codec("diffdrive")


def source() -> Source:
    return Source(DIFFDRIVE, End.HOST, 0.01)


def strikes(of: Source) -> list[tuple[float, str]]:
    return [
        (round(mark["t"], 6), mark["action"]) for mark in of.marks.since(0) if mark["kind"] == "mcu_deadline_struck"
    ]


def drive(of: Source, times: list[float]) -> None:
    of.feed(End.HOST, [DIFFDRIVE.encode("velocity", linear=0.5, angular=0.0)] * len(times), times)


def test_a_deadline_at_the_mcu_is_marked_once_when_it_strikes() -> None:
    of = source()
    drive(of, [1.0, 1.5, 2.0])
    for now in (2.5, 2.99):
        of.look(now)
        assert strikes(of) == []
    for now in (3.0, 3.02, 4.0):
        of.look(now)
        assert strikes(of) == [(3.0, "stop")]
    for now in (5.0, 6.0, 60.0):
        of.look(now)
        assert strikes(of) == [(3.0, "stop"), (5.0, "safe_mode")]


@pytest.mark.parametrize("apart", [False, True], ids=["read whole", "as it came"])
def test_silences_between_messages_are_marked_however_they_are_fed(apart: bool) -> None:
    of = source()
    times = [1.0, 1.5, 3.0, 3.5, 5.0]
    for part in [[t] for t in times] if apart else [times]:
        drive(of, part)
    of.look(5.1)
    assert strikes(of) == [(2.5, "stop"), (4.5, "stop")]


def test_after_an_explicit_deadline_nothing_strikes_until_it_is_ended() -> None:
    of = source()
    drive(of, [1.0, 10.0, 12.0])
    of.look(12.0)
    assert strikes(of) == [(2.0, "stop"), (4.0, "safe_mode")]
    of.feed(End.HOST, [DIFFDRIVE.encode("parameter", name="clear_safe_mode", value=0)], [13.0])
    of.look(20.0)
    assert strikes(of)[2:] == [(14.0, "stop"), (16.0, "safe_mode")]


def frame(number: int, is_damaged: bool) -> bytes:
    data = bytearray(DIFFDRIVE.encode("odometry", left_ticks=number, right_ticks=0))
    data[5] ^= 0x40 if is_damaged else 0
    return bytes(data)


@pytest.mark.parametrize("whole", [False, True], ids=["as it came", "read whole"])
def test_discarded_bytes_are_marked_when_they_came(whole: bool) -> None:
    of, size = source(), len(frame(0, False))
    damaged = {20, 21, 60}
    chunks = [frame(number, number in damaged) for number in range(100)]
    times = [number * 0.05 for number in range(100)]
    if whole:
        of.feed(End.MCU, chunks, times)
    else:
        for chunk, t in zip(chunks, times, strict=True):
            of.feed(End.MCU, [chunk], [t])
    held: dict[float, Any] = {mark["t"]: mark for mark in of.marks.since(0)}
    assert {(mark["kind"], mark["direction"]) for mark in held.values()} == {("discarded", "received")}
    assert [(round(t, 6), mark["bytes"]) for t, mark in held.items()] == [(1.0, 2 * size), (3.0, size)]
    assert sum(mark["bytes"] for mark in held.values()) == sum(of.streams[End.MCU].stats()["discarded_bytes"].values())


def test_only_new_ones_are_reported_and_the_oldest_go_first() -> None:
    marks = Marks(most=3)
    marks.discarded(1.0, "received", 5)
    known = marks.newest
    marks.discarded(1.1, "received", 2)
    assert marks.since(known) == [{"t": 1.0, "kind": "discarded", "direction": "received", "bytes": 7}]
    for number in range(5):
        marks.struck(2.0 + number, "stop", "velocity")
    assert [mark["t"] for mark in marks.since(0)] == [4.0, 5.0, 6.0]
    assert marks.since(marks.newest) == []


@pytest.mark.parametrize(("until", "seen"), [(0.9, 0), (1.0, 1), (1.5, 1), (2.5, 2), (None, 2)])
def test_the_last_discarded_bytes_are_seen_at_every_position(until: float | None, seen: int) -> None:
    of = source()
    damaged = frame(7, True)
    of.feed(
        End.MCU, [frame(1, False), damaged, frame(2, False), damaged, frame(3, False)[:4]], [0.5, 1.0, 1.5, 2.0, 9.0]
    )
    found = of.streams[End.MCU].newest(10, "", True, until)
    assert [entry.bytes for entry in found] == [damaged] * seen
