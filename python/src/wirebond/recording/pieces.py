"""The pieces of a recording, read from its file again and again, some MiB at a time: all reads and writes of its port,
and its events, in their order."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wirebond import _engine
from wirebond.link.tap import Chunk, LinkEvent
from wirebond.recording import layout
from wirebond.recording.scan import Contents, Run, Scan
from wirebond.recording.searching import Source

Progress = Callable[[int, int], object]
KINDS = ("received", "sent", "event")
_TOPICS = {layout.RECEIVED: 0, layout.SENT: 1, layout.EVENTS: 2}
_NONE = 255
_NEWEST = 2  # in the list of latest times
_FAR = 60.0  # seconds; a piece so far from both its neighbours, which are close to each other, has a damaged time


@dataclass(frozen=True)
class Pieces:
    """Some pieces that follow each other. Times are seconds since the start.

    :ivar run: where their bytes are.
    :ivar rows: of each piece in the run.
    :ivar kinds: of each: an index of ``KINDS``.
    :ivar times: when each was done.
    :ivar before: when each began; within a direction they do not fall.
    """

    run: Run
    rows: NDArray[np.intp]
    kinds: NDArray[np.uint8]
    times: NDArray[np.float64]
    before: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.rows)

    def part(self, begin: int, end: int) -> Pieces:
        """Return some of them."""
        part = slice(begin, end)
        return Pieces(self.run, self.rows[part], self.kinds[part], self.times[part], self.before[part])

    def chunk(self, index: int) -> Chunk:
        """Return a read or a write."""
        data = self.run.payload(int(self.rows[index]))
        return Chunk(float(self.times[index]), float(self.before[index]), KINDS[self.kinds[index]], data)

    def event(self, index: int) -> LinkEvent | None:
        """Read an event; None: it is damaged."""
        try:
            values = json.loads(self.run.payload(int(self.rows[index])))
            values.pop("t", None)
            return LinkEvent(float(self.times[index]), str(values.pop("kind")), values)
        except (ValueError, KeyError, AttributeError, RecursionError):
            return None


@dataclass(frozen=True)
class Direction:
    """The reads, or the writes: their bytes, and the end of each.

    :ivar breaks: the port was away before the read of each of these indices.
    """

    data: bytes
    ends: NDArray[np.uint64]
    before: NDArray[np.float64]
    breaks: list[int]


class PieceFile:
    """A recording's file. Any thread.

    :ivar contents: what its records say.
    :ivar start_ns: when it began, in nanoseconds since 1970.
    :ivar count: how many pieces there are.
    :ivar last: seconds since the start of the last read or write.
    :ivar sizes: bytes of each direction.
    :ivar events: all of them.
    :raises WirebondError: it is not an MCAP file.
    :raises OSError: it cannot be read.
    """

    def __init__(self, path: Path, progress: Progress | None) -> None:
        self._source = Source(path)
        self.size = self._source.size
        self.start_ns = 0
        self.count = 0
        self.last = 0.0
        self.sizes = {"received": 0, "sent": 0}
        scan = Scan(self._source)
        self.contents: Contents = scan.contents
        found: list[LinkEvent] = []
        for run in scan.runs(progress):
            pieces = self._pieces(run, [0.0, 0.0, 0.0])
            self._look(pieces, found)
        self.events = tuple(found)

    def _look(self, pieces: Pieces, events: list[LinkEvent]) -> None:
        """Collect the facts that the first pass needs."""
        if not len(pieces):
            return
        self.count += len(pieces)
        for kind in (0, 1):
            mine = pieces.kinds == kind
            self.sizes[KINDS[kind]] += int(pieces.run.sizes[pieces.rows[mine]].sum())
            self.last = max(self.last, float(pieces.times[mine].max(initial=0.0)))
        for index in np.flatnonzero(pieces.kinds == 2).tolist():
            event = pieces.event(index)
            if event is not None:
                events.append(event)

    def passes(self, progress: Progress | None = None) -> Iterator[Pieces]:
        """Yield all pieces, some thousands at a time.

        :param progress: called as ``progress(done, size)``, in bytes of the file.
        """
        scan, latest = Scan(self._source), [0.0, 0.0, 0.0]
        scan.contents.channels.update(self.contents.channels)
        for run in scan.runs(progress):
            pieces = self._pieces(run, latest)
            if len(pieces):
                yield pieces

    def direction(self, kind: int) -> Direction:
        """Return all of one direction, in memory."""
        data, sizes, before = [], [], []
        breaks: list[int] = []
        count = 0
        for pieces in self.passes():
            mine = pieces.kinds == kind
            rows = pieces.rows[mine]
            for index in np.flatnonzero(pieces.kinds == 2).tolist():
                event = pieces.event(index)
                if event is not None and event.kind == "port_down":
                    breaks.append(count + int(mine[:index].sum()))
            count += len(rows)
            data.append(_engine.gathered(pieces.run.data, pieces.run.places[rows], pieces.run.sizes[rows]))
            sizes.append(pieces.run.sizes[rows])
            before.append(pieces.before[mine])
        if not data:
            return Direction(b"", np.zeros(0, np.uint64), np.zeros(0), [])
        ends = np.cumsum(np.concatenate(sizes), dtype=np.uint64)
        return Direction(b"".join(data), ends, np.concatenate(before), sorted(set(breaks)))

    def _pieces(self, run: Run, latest: list[float]) -> Pieces:
        """Read a run of pieces. ``latest``: of each direction when its last piece before this run began, and when the
        last one of all was done."""
        table = np.full(1 << 16, _NONE, np.uint8)
        for number, channel in self.contents.channels.items():
            table[number] = _TOPICS.get(channel.topic, _NONE)
        of = table[run.channels]
        rows = np.flatnonzero(of != _NONE)
        kinds = of[rows]
        if not self.start_ns and len(rows):
            self.start_ns = self._start(int(run.logged[rows[0]]))
        times, before = self._seconds(run.logged[rows]), self._seconds(run.published[rows])
        times, before = _plausible(times, before, latest[_NEWEST])
        latest[_NEWEST] = float(times[-1]) if len(times) else latest[_NEWEST]
        for kind in (0, 1):
            mine = kinds == kind
            if mine.any():
                before[mine] = np.maximum.accumulate(np.maximum(before[mine], latest[kind]))
                latest[kind] = float(before[mine][-1])
        return Pieces(run, rows, kinds, times, before)

    def _start(self, first_ns: int) -> int:
        text = self.contents.metadata.get(layout.METADATA, {}).get("started_ns", "")
        return int(text) if text.isdecimal() and len(text) < 20 else first_ns

    def _seconds(self, nanoseconds: NDArray[np.uint64]) -> NDArray[np.float64]:
        """Convert to seconds, never before the start: a damaged time is no reason to stop."""
        start = np.uint64(min(self.start_ns, (1 << 64) - 1))
        later = np.where(nanoseconds > start, nanoseconds - start, np.uint64(0))
        return np.minimum(later, np.uint64(10**18)).astype(np.float64) / 1e9


def _plausible(
    times: NDArray[np.float64], begun: NDArray[np.float64], previous: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Replace implausible times: one wrong time must not move all that follow. ``previous``: of the piece before
    these."""
    if not len(times):
        return times, begun
    before, after = np.concatenate([[previous], times[:-1]]), np.concatenate([times[1:], times[-1:]])
    alone = np.minimum(np.abs(times - before), np.abs(times - after)) > _FAR
    times = np.where(alone & (np.abs(after - before) < _FAR), before, times)
    before = np.concatenate([[previous], times[:-1]])
    apart = np.abs(times - begun) > _FAR  # a read takes no minute: one of the two is wrong
    times = np.where(apart & (np.abs(begun - before) < np.abs(times - before)), begun, times)
    return times, np.where(apart, times, begun)
