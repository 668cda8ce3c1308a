"""The history of a link: fed as its bytes come, bounded, and the same as what the columns of a recording say."""

from __future__ import annotations

import mmap
import random
import tracemalloc
import weakref
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import pytest

import wirebond
from tests.shared import codec
from tests.streams import random_values
from tests.waiting import PATIENCE, wait_until
from wirebond.console.views.messages import message_rows
from wirebond.errors import UsageError
from wirebond.generate.new.template import template_text
from wirebond.link.tap import LinkEvent
from wirebond.protocol import loads
from wirebond.protocol.model import End
from wirebond.recording.history import track
from wirebond.recording.history.recorded import recorded_source
from wirebond.recording.history.source import ENDS, Source
from wirebond.recording.recording import Recording
from wirebond.sim.pty_port import PtyPort


def source_of(name: str, **options: Any) -> Source:
    proto = codec(name)
    return Source(proto, End.HOST, proto.model.idle_seconds, **options)


def pieces(data: bytes, seed: int) -> list[bytes]:
    cuts = random.Random(seed)
    out = []
    while data:
        size = cuts.randint(1, 40)
        out.append(data[:size])
        data = data[size:]
    return out


@pytest.mark.parametrize("name", ["diffdrive", "native", "servo_bus", "pid_tuner"])
def test_bytes_in_any_pieces_give_the_rows_and_the_account_of_the_whole(name: str) -> None:
    proto = codec(name)
    noise = random.Random(5)
    for end in ENDS:
        frames = []
        for message in [m for m in proto.model.messages if m.sent_by(end)] * 6:
            frames.append(proto.encode(message.name, random_values(message, noise), sender=end.value))
            if noise.random() < 0.4:
                frames.append(noise.randbytes(noise.randint(1, 30)))
        data = b"".join(frames)
        source = source_of(name)
        for number, chunk in enumerate(pieces(data, 1)):
            source.feed(end, [chunk], [number * 1e-6])
        source.feed(end, [], [], [0])  # the port goes away: what is incomplete is given up
        wanted = proto.decode_columns(data, sender=end.value)
        stats = source.streams[end].stats()
        assert stats["frames"] == wanted.stats.frames
        assert wanted.stats.frames >= 6
        assert stats["discarded_bytes"] == wanted.stats.discarded_bytes
        for message_name, table in wanted.items():
            if message_name != "unknown":
                assert source.history.count(end, message_name) == len(table)
        entries = source.entries(500, None, True)
        assert b"".join(entry.bytes for _, entry, _ in entries) == data[: sum(e.size for _, e, _ in entries)]
        assert sum(entry.name != "" for _, entry, _ in entries) == wanted.stats.frames
        for _, entry, message in entries:
            assert (message is None) == (entry.name == "")
            assert message is None or (message.name == entry.name and message.raw == entry.bytes)


def test_a_field_has_the_values_of_its_messages() -> None:
    source, proto = source_of("diffdrive"), codec("diffdrive")
    chunks = [proto.encode("odometry", left_ticks=n, right_ticks=-n) for n in range(100)]
    source.feed(End.MCU, chunks, [n * 0.05 for n in range(100)])
    t, values = source.history.rows("odometry.right_ticks")
    np.testing.assert_array_equal(values, -np.arange(100))
    np.testing.assert_allclose(t, np.arange(100) * 0.05)
    newest = source.newest(End.MCU, "odometry")
    assert newest is not None and newest.message is not None and newest.message["left_ticks"] == 99
    then = source.newest_until(End.MCU, "odometry", 2.02)
    assert then is not None and then.message is not None and then.message["left_ticks"] == 40


@pytest.mark.parametrize("field", ["nothing.x", "odometry", "odometry.none", "", ".", "mcu:velocity.linear", "a:b.c"])
def test_a_field_that_does_not_exist_is_a_sentence(field: str) -> None:
    with pytest.raises(UsageError, match=r"it has|names no message"):
        source_of("diffdrive").history.pixels([field], 0.0, 1.0, 0.1)


def test_memory_is_bounded_and_the_oldest_rows_go_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(track, "ROWS", 1024)
    monkeypatch.setattr(track, "BLOCK", 64)
    most = 400_000
    source, proto = source_of("diffdrive", most=most, keep=10_000), codec("diffdrive")
    frame = proto.encode("odometry", left_ticks=1, right_ticks=2)
    for n in range(300):
        source.feed(End.MCU, [frame] * 100, [n + i / 100 for i in range(100)])
        assert source.history.bytes <= most
        assert len(source.streams[End.MCU]._bytes) <= 20_000 + len(frame) * 100
    kept = source.history.range()
    assert kept is not None and kept[0] > 100 and kept[1] > 299
    assert source.history.count(End.MCU, "odometry") == 30_000


class Mapped(mmap.mmap):
    """A mapping that counts its bytes as long as it exists."""

    bytes: ClassVar[int] = 0

    def __new__(cls, number: int, size: int, **options: int) -> Self:
        made = super().__new__(cls, number, size, **options)
        cls.bytes += size
        weakref.finalize(made, cls._end, size)
        return made

    @classmethod
    def _end(cls, size: int) -> None:
        cls.bytes -= size


def test_the_reported_memory_is_what_it_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted where it is allocated: what the process has in memory also depends on what it had free before."""
    monkeypatch.setattr(mmap, "mmap", Mapped)
    source = source_of("diffdrive")
    columns = source.history.columns(End.MCU, "odometry")
    values = {column: np.zeros(10_000, np.int16) for column in columns}
    tracemalloc.start()
    try:
        before, told = tracemalloc.get_traced_memory()[0] + Mapped.bytes, source.history.bytes
        for n in range(300):
            source.history.add(End.MCU, {"odometry": {"t": np.arange(n, n + 1, 1e-4), "fields": values}})
        grown = tracemalloc.get_traced_memory()[0] + Mapped.bytes - before
        told = source.history.bytes - told
    finally:
        tracemalloc.stop()
    assert told > 300 * 10_000 * (8 + 2 * len(columns))
    assert grown == pytest.approx(told, rel=0.05)


def test_the_bytes_and_frames_that_are_kept_count_as_memory() -> None:
    source, proto = source_of("diffdrive"), codec("diffdrive")
    empty = source.history.bytes
    frame = proto.encode("odometry", left_ticks=1, right_ticks=2)
    source.feed(End.MCU, [frame * 100] * 100, [float(n) for n in range(100)])
    rows = source.history.bytes - empty - source.history.beside
    assert source.history.beside > len(frame) * 10_000 and rows > 10_000 * 12


def test_the_line_s_absence_is_a_gap_and_an_event() -> None:
    source, proto = source_of("diffdrive"), codec("diffdrive")
    frame = proto.encode("odometry", left_ticks=1, right_ticks=2)
    source.feed(End.MCU, [frame] * 3, [1.0, 1.05, 1.1])
    source.happened(LinkEvent(1.12, "port_down", {"why": "unplugged"}))
    source.feed(End.MCU, [frame] * 2, [1.15, 1.2], [0])
    [found] = source.history.pixels(["odometry.left_ticks"], 0.0, 2.0, 0.001)
    assert np.isnan(found.low).tolist() == [False, False, False, True, False, False]
    (event,) = source.happenings.since(0)
    assert event["text"] == "the port is away: unplugged" and event["why"] == "unplugged"


def test_a_rate_is_right_from_the_first_second_on() -> None:
    source, proto = source_of("diffdrive"), codec("diffdrive")
    frame = proto.encode("odometry", left_ticks=1, right_ticks=2)
    for n in range(200):
        source.feed(End.MCU, [frame], [10 + n * 0.05])
        rows = {row["name"]: row for row in message_rows(source, 10 + n * 0.05, at=None, with_sparks=False)}
        if n >= 20:
            assert rows["odometry"]["rate"] == pytest.approx(20, rel=0.06)
    late = {row["name"]: row for row in message_rows(source, 40.0, at=None, with_sparks=False)}
    assert late["odometry"]["rate"] == 0 and late["odometry"]["due"] == 20


def test_the_small_line_beside_a_message_is_of_a_value_and_not_of_its_time_stamp() -> None:
    proto = wirebond.Codec(loads(template_text("native", "legs", {"joints": 2}), "legs.yaml"))
    source = Source(proto, End.HOST, proto.model.idle_seconds)
    joints = [{"position": 0.5, "velocity": 0, "torque": 0}] * 2
    source.feed(End.MCU, [proto.encode("joint_states", measured=5, joints=joints)], [10.0])
    [row] = [r for r in message_rows(source, 10.1, at=None, with_sparks=True) if r["name"] == "joint_states"]
    assert row["spark"]["field"] == "joints[0].position"


@pytest.mark.parametrize("moment", ["while it is counted", "while the newest is read"])
def test_a_message_that_is_counted_has_its_newest_frame(moment: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """One thread feeds, and another one looks in between."""
    source, proto = source_of("diffdrive"), codec("diffdrive")
    frame = proto.encode("odometry", left_ticks=1, right_ticks=2)
    looks: list[dict[str, Any]] = []

    def look() -> None:
        looks.extend(row for row in message_rows(source, 10.1, at=None, with_sparks=False) if row["name"] == "odometry")

    if moment == "while it is counted":
        add = source.history.add
        monkeypatch.setattr(source.history, "add", lambda end, tables: (add(end, tables), look()))
        source.feed(End.MCU, [frame], [10.0])
    else:
        newest = source.newest

        def newest_then_feed(end: End, name: str) -> Any:
            found = newest(end, name)
            if name == "odometry":
                source.feed(End.MCU, [frame], [10.0])
            return found

        monkeypatch.setattr(source, "newest", newest_then_feed)
        look()
        look()
    assert looks and all("fields" in row for row in looks if row["count"])


def test_round_trips_are_from_a_request_to_its_reply() -> None:
    source, proto = source_of("diffdrive"), codec("diffdrive")
    ask = proto.encode("status_query")
    reply = proto.encode("status", battery=12.0, errors=[], state=[])
    for n in range(20):
        source.feed(End.HOST, [ask], [n * 1.0])
        source.feed(End.MCU, [reply], [n * 1.0 + 0.004])
    figures = source.round_trips.figures(20.0)
    assert figures is not None and figures["count"] == 20 and figures["p99"] == pytest.approx(0.004)
    assert source.round_trips.figures(1000.0) is None


@pytest.mark.live
def test_a_recording_is_the_same_source(tmp_path: Path) -> None:
    proto, pty = codec("diffdrive"), PtyPort()
    path = tmp_path / "run.mcap"
    with wirebond.open(proto, pty.path) as link, link.record(path):
        for n in range(20):
            pty.write(proto.encode("odometry", left_ticks=n, right_ticks=0))
            assert link.receive(PATIENCE)
        link.send("velocity", linear=0.5, angular=0.0)
        wait_until(lambda: link.stats.send.sent, "the velocity leaves")
    pty.close()
    recording = Recording(path)
    source = recorded_source(recording)
    for sender in ENDS:
        for name, table in recording.columns(sender.value).items():
            for column, values in table.items():
                t, kept = source.history.rows(f"{name}.{column}")
                np.testing.assert_allclose(kept, values, rtol=1e-6)
                np.testing.assert_array_equal(t, table.t)
    assert [e["kind"] for e in source.happenings.since(0)] == [event.kind for event in recording.events]
