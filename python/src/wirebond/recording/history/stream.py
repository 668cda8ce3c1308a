"""A direction of a line: its newest bytes, the frames in them, and the bytes between frames. No thread, no clock."""

from __future__ import annotations

import bisect
import sys
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wirebond import _engine
from wirebond.codec import Codec, Message
from wirebond.protocol.model import End
from wirebond.protocol.planning import plan_for
from wirebond.recording.history.track import OF_ARRAY

KEPT_BYTES = 1 << 20  # of a live line: ten seconds at 1 Mbaud
_OF_READ = 72  # bytes of memory: where it ends and when it began, as objects in two lists
_MOST_DISCARD = 256  # bytes of one entry


@dataclass(frozen=True)
class Entry:
    """A frame, or bytes between two frames.

    :ivar offset: of its first byte, from the first one of all; it names the entry within its direction.
    :ivar name: of a frame's message; empty: it is not a frame.
    :ivar bytes: of a discard at most 256.
    :ivar size: how many there are.
    """

    t: float
    offset: int
    size: int
    name: str
    bytes: bytes


@dataclass(frozen=True)
class _Frames:
    """Frames of one batch, in their order."""

    t: NDArray[np.float64]
    offset: NDArray[np.uint64]
    size: NDArray[np.uint32]
    kind: NDArray[np.int64]  # index of the name

    @property
    def held_bytes(self) -> int:
        return sum(array.nbytes + OF_ARRAY for array in (self.t, self.offset, self.size, self.kind))


class Stream:
    """:param end: that sends these bytes.
    :param idle: seconds of silence that end an incomplete frame.
    :param keep: bytes that are kept; None: all.
    """

    def __init__(self, codec: Codec, end: End, idle: float, keep: int | None = KEPT_BYTES) -> None:
        self.end = end
        self._codec = codec
        self._follower = _engine.Follower(codec.tables.protocol, codec.tables.format_for(end), idle)
        self.names = [*(m.name for m in codec.model.messages), "unknown"]
        self._numbers = {name: number for number, name in enumerate(self.names)}
        plan = plan_for(codec.model, end)
        self._delimiters = bytes(set(plan.opening + plan.closing))
        self._asking = {m.reply: m.name for m in codec.model.messages if m.reply is not None}
        self._keep = keep
        self._bytes = bytearray()
        self._begin = 0  # the offset of the first byte that is kept
        self._read_ends: list[int] = []  # of the reads whose bytes are kept, as offsets
        self._read_times: list[float] = []
        self._frames: deque[_Frames] = deque()
        self._frames_bytes = 0
        self._settled = 0  # up to here it is known which bytes are in frames
        self._discards: list[tuple[float, int]] = []

    @property
    def held_bytes(self) -> int:
        """The memory of the kept bytes."""
        return sys.getsizeof(self._bytes) + self._frames_bytes + len(self._read_ends) * _OF_READ

    def tables(self) -> dict[str, Any]:
        """Return the columns of all messages, without rows."""
        return self._follower.tables()

    def stats(self) -> dict[str, Any]:
        """Return the account."""
        return self._follower.stats()

    # ---- in

    def feed(
        self,
        chunks: Sequence[bytes],
        times: Sequence[float],
        breaks: Sequence[int] = (),
        expected: Sequence[tuple[int, int]] = (),
    ) -> dict[str, Any]:
        """Take bytes as they came. Returns the completed messages by name: ``t``, ``fields``, ``offset``, ``size``."""
        data = b"".join(chunks)
        ends = np.cumsum([len(chunk) for chunk in chunks], dtype=np.uint64)
        return self.feed_whole(data, ends, np.asarray(times, np.float64), breaks, expected)

    def feed_whole(
        self,
        data: bytes,
        ends: NDArray[np.uint64],
        times: NDArray[np.float64],
        breaks: Sequence[int] = (),
        expected: Sequence[tuple[int, int]] = (),
    ) -> dict[str, Any]:
        """Do the same for bytes that are already together; ``ends``: the end of each read."""
        reads = {"ends": ends, "times": times, "breaks": list(breaks), "expected": list(expected)}
        tables = self._follower.feed(data, reads)
        begin = self._begin + len(self._bytes)
        self._bytes += data
        self._read_ends += (ends + np.uint64(begin)).tolist()
        self._read_times += times.tolist()
        self._note(tables)
        self._note_discards(tables)
        self._trim()
        return tables

    def idle(self, t: float) -> dict[str, Any]:
        """Note that a read that began at ``t`` found nothing."""
        tables = self._follower.idle(t)
        self._note(tables)
        self._note_discards(tables)
        return tables

    def _note(self, tables: dict[str, Any]) -> None:
        if not tables:
            return
        kind = np.concatenate([np.full(len(table["t"]), self._numbers[name]) for name, table in tables.items()])
        t, offset, size = (np.concatenate([table[key] for table in tables.values()]) for key in ("t", "offset", "size"))
        order = np.argsort(offset, kind="stable")
        self._frames.append(_Frames(t[order], offset[order], size[order], kind[order]))
        self._frames_bytes += self._frames[-1].held_bytes

    def _note_discards(self, tables: dict[str, Any]) -> None:
        settled = self._follower.settled()
        each = [(table["offset"], table["size"]) for table in tables.values()]
        offsets = np.concatenate([np.empty(0, np.int64), *(offset.astype(np.int64) for offset, _ in each)])
        sizes = np.concatenate([np.empty(0, np.int64), *(size.astype(np.int64) for _, size in each)])
        order = np.argsort(offsets, kind="stable")
        ends = np.concatenate(([self._settled], (offsets + sizes)[order]))
        begins = np.append(offsets[order], max(settled, int(ends[-1])))
        self._settled = int(begins[-1])
        for place in np.flatnonzero(begins > ends).tolist():
            begin = int(ends[place])
            size = len(self.raw(begin, int(begins[place]) - begin).strip(self._delimiters))
            if size and self._read_times:
                read = bisect.bisect_right(self._read_ends, begin)
                self._discards.append((self._read_times[min(read, len(self._read_times) - 1)], size))

    def take_discards(self) -> list[tuple[float, int]]:
        """Return when bytes arrived that are in no frame, and how many, without delimiters: since the last call."""
        found, self._discards = self._discards, []
        return found

    def _trim(self) -> None:
        if self._keep is None or len(self._bytes) <= 2 * self._keep:
            return
        drop = len(self._bytes) - self._keep
        del self._bytes[:drop]
        self._begin += drop
        reads = bisect.bisect_right(self._read_ends, self._begin)
        del self._read_ends[:reads], self._read_times[:reads]
        while self._frames and self._frames[0].offset[-1] < self._begin:
            self._frames_bytes -= self._frames.popleft().held_bytes

    # ---- out

    def kept(self, seconds: float) -> tuple[bytes, NDArray[np.uint64], NDArray[np.float64]]:
        """Return the bytes of the reads of the last seconds, where each read ends, and when each began."""
        times, ends = np.asarray(self._read_times), np.asarray(self._read_ends, np.uint64)
        if not len(times):
            return b"", ends, times
        first = int(np.searchsorted(times, times[-1] - seconds))
        begin = self._begin if first == 0 else int(ends[first - 1])
        return self.raw(begin, int(ends[-1]) - begin), ends[first:] - np.uint64(begin), times[first:]

    def raw(self, offset: int, size: int) -> bytes:
        """Return these bytes; fewer if some are no longer kept."""
        at = max(offset - self._begin, 0)
        return bytes(self._bytes[at : max(offset + size - self._begin, 0)])

    def message(self, raw: bytes, name: str, t: float) -> Message | None:
        """Return the message in one frame."""
        decoder = self._codec.decoder(self.end)
        if name in self._asking:
            decoder.expect(self._asking[name])
        found = [*decoder.feed(raw, t), *decoder.finish()]
        return found[0] if found else None

    def reads(self, most: int) -> list[Entry]:
        """Return the bytes of the last reads, as they came, oldest first."""
        found = []
        for i in range(max(0, len(self._read_ends) - most), len(self._read_ends)):
            begin = self._begin if i == 0 else self._read_ends[i - 1]
            size = self._read_ends[i] - begin
            found.append(Entry(self._read_times[i], begin, size, "", self.raw(begin, min(size, _MOST_DISCARD))))
        return found

    def newest(self, most: int, name: str | None, with_discards: bool, until: float | None = None) -> list[Entry]:
        """Return the last entries, oldest first.

        :param name: frames of this message alone; None: all; empty: none, and no delimiters either.
        :param until: none that came after this time.
        """
        found: list[Entry] = []
        wanted = None if name is None else self._numbers.get(name, -1)
        for entry in self._backwards(wanted, with_discards, until):
            if name == "" and self.is_fill(entry):
                continue
            found.append(entry)
            if len(found) == most:
                break
        return found[::-1]

    def _backwards(self, wanted: int | None, with_discards: bool, until: float | None) -> Iterator[Entry]:
        next_begin = self._follower.settled()
        if until is not None:
            read = bisect.bisect_right(self._read_times, until)
            next_begin = min(next_begin, self._read_ends[read - 1] if read else 0)
        for frames in reversed(self._frames):
            if until is not None and frames.t[0] > until:
                next_begin = min(next_begin, int(frames.offset[0]))
                continue
            for i in range(len(frames.t) - 1, -1, -1):
                t = float(frames.t[i])
                offset, size, kind = int(frames.offset[i]), int(frames.size[i]), int(frames.kind[i])
                if until is not None and t > until:
                    next_begin = min(next_begin, offset)
                    continue
                if with_discards and next_begin > offset + size:
                    yield from self._between(offset + size, next_begin)
                next_begin = offset
                if offset < self._begin:
                    return
                if wanted is None or kind == wanted:
                    yield Entry(t, offset, size, self.names[kind], self.raw(offset, size))
        if with_discards and next_begin > self._begin:
            yield from self._between(self._begin, next_begin)

    def _between(self, begin: int, end: int) -> Iterator[Entry]:
        read = bisect.bisect_right(self._read_ends, begin)
        t = self._read_times[min(read, len(self._read_times) - 1)]
        yield Entry(t, begin, end - begin, "", self.raw(begin, min(end - begin, _MOST_DISCARD)))

    def is_fill(self, entry: Entry) -> bool:
        """Check whether these bytes are nothing but delimiters."""
        return bool(self._delimiters) and not entry.bytes.strip(self._delimiters)
