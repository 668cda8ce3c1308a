"""Recordings for tests, made without a port and without a clock."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import wirebond
from wirebond.link.tap import Chunk, LinkEvent
from wirebond.recording.writer import RecordingWriter

STARTED = 100.0  # seconds of the pieces' clock
WALL_NS = 1_795_000_000 * 10**9


def made(
    path: Path,
    codec: wirebond.Codec,
    pieces: Iterable[Chunk | LinkEvent],
    *,
    role: str = "host",
    finished: bool = True,
    batch: int = 20,
) -> Path:
    """A recording of these pieces, whose times count from the start."""
    writer = RecordingWriter(path, codec, role, STARTED, WALL_NS, {"port": "made"})
    for number, piece in enumerate(pieces, 1):
        if isinstance(piece, Chunk):
            moved: Chunk | LinkEvent = Chunk(STARTED + piece.t, STARTED + piece.before, piece.direction, piece.bytes)
        else:
            moved = LinkEvent(STARTED + piece.t, piece.kind, piece.facts)
        writer.add(moved)
        if number % batch == 0:
            writer.flush()
    writer.flush()
    if finished:
        writer.finish()
    writer.close()
    return path


def drive(codec: wirebond.Codec, seconds: float) -> Iterable[Chunk | LinkEvent]:
    """A rover: velocity and odometry 20 times a second, the status each second."""
    yield LinkEvent(0.0, "port_up")
    for step in range(round(seconds * 20)):
        t = step * 0.05
        velocity = codec.encode("velocity", linear=0.5, angular=round(0.001 * (step % 1000), 3))
        yield Chunk(t + 0.001, t + 0.001, "sent", velocity)
        odometry = codec.encode("odometry", left_ticks=step % 1000, right_ticks=-(step % 1000))
        if step % 3 == 0:  # in two reads
            yield Chunk(t + 0.0202, t + 0.02, "received", odometry[:4])
            yield Chunk(t + 0.0206, t + 0.0204, "received", odometry[4:])
        else:
            yield Chunk(t + 0.0206, t + 0.0204, "received", odometry)
        if step % 20 == 0:
            yield Chunk(t + 0.03, t + 0.03, "sent", codec.encode("status_query"))
            status = codec.encode("status", {"battery": 12.0, "errors": ["encoder"], "state": []})
            yield Chunk(t + 0.0321, t + 0.032, "received", status)
    yield LinkEvent(seconds, "port_down", {"why": "the end"})
