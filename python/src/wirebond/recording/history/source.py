"""The source of all views: a line's history, its newest bytes and its events. Live links and recordings are sources."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wirebond.codec import Codec, Message
from wirebond.link.log_lines import LineLimit, log_names
from wirebond.link.raw import is_raw
from wirebond.link.tap import LinkEvent
from wirebond.protocol.model import End
from wirebond.protocol.planning import told_by_request
from wirebond.recording.history import happenings, marks
from wirebond.recording.history.happenings import Happenings
from wirebond.recording.history.history import MOST_BYTES, History
from wirebond.recording.history.marks import Marks
from wirebond.recording.history.mcu_deadlines import McuDeadlines
from wirebond.recording.history.round_trips import RoundTrips
from wirebond.recording.history.stream import KEPT_BYTES, Entry, Stream
from wirebond.recording.recording import Reads

ENDS = (End.HOST, End.MCU)


class Newest:
    """The newest frame of one message of one end."""

    __slots__ = ("message", "offset", "raw", "t")

    def __init__(self, t: float, offset: int, raw: bytes) -> None:
        self.t = t
        self.offset = offset
        self.raw = raw
        self.message: Message | None = None  # decoded when first asked for


class Source:
    """One thread feeds it; any thread reads it.

    :param idle: seconds of silence that end an incomplete frame.
    :param most: bytes of the history; None: all.
    :param keep: bytes of each direction; None: all.
    """

    def __init__(
        self,
        codec: Codec,
        role: End,
        idle: float,
        *,
        most: int | None = MOST_BYTES,
        keep: int | None = KEPT_BYTES,
    ) -> None:
        self.codec = codec
        self.role = role
        self.streams = {end: Stream(codec, end, idle, keep) for end in ENDS}
        self.history = History(codec.model, {end: self.streams[end].tables() for end in ENDS}, most)
        self.happenings = Happenings(None if keep is None else happenings.MOST_KEPT)
        self.marks = Marks(None if keep is None else marks.MOST_KEPT)
        self.round_trips = RoundTrips()
        self.mcu_deadlines = McuDeadlines(codec.model)
        self._lock = threading.RLock()  # of the members below, and of the streams
        self._newest: dict[tuple[End, str], Newest] = {}
        model = codec.model
        self._replies = {m.name: m.reply for m in model.messages if m.reply is not None}
        self._told = {end: bool(told_by_request(model.messages, end)) for end in ENDS}
        self._asked: list[tuple[float, int]] = []  # of requests that no read has followed: when, and the reply's index
        self._log_names = set(log_names(codec))
        self._log_limit = LineLimit()

    # ---- in

    def feed(
        self,
        end: End,
        chunks: Sequence[bytes],
        times: Sequence[float],
        breaks: Sequence[int] = (),
    ) -> None:
        """Take bytes that this end sent, as they came. Feed the host's bytes before the MCU's of the same time."""
        with self._lock:
            expected = self._expected(times) if self._told[end] else []
            tables = self.streams[end].feed(chunks, times, breaks, expected)
        self._take(end, tables)

    def feed_whole(
        self,
        end: End,
        data: bytes,
        ends: NDArray[np.uint64],
        times: NDArray[np.float64],
        breaks: Sequence[int],
        expected: Sequence[tuple[int, int]] | None = None,
    ) -> None:
        """Take all bytes of this end at once, and which replies were requested before which read; None: the host's
        bytes decide."""
        with self._lock:
            if expected is None:
                expected = self._expected(times.tolist()) if self._told[end] else []
            tables = self.streams[end].feed_whole(data, ends, times, breaks, expected)
        self._take(end, tables)

    def idle(self, end: End, t: float) -> None:
        """Note that no bytes of this end came up to ``t``."""
        with self._lock:
            tables = self.streams[end].idle(t)
        self._mark_discards(end)
        if tables:
            self._take(end, tables)

    def happened(self, event: LinkEvent) -> None:
        """Note an event of the line."""
        if event.kind == "port_down":
            self.history.add_break(event.t)
        self.happenings.add(event)

    def look(self, now: float) -> None:
        """Mark the deadlines at the MCU that have struck by this time."""
        for t, rule in self.mcu_deadlines.strikes(now):
            self.marks.struck(t, rule.then, rule.message)

    def _mark_discards(self, end: End) -> None:
        if is_raw(self.codec):
            return
        direction = "sent" if end == self.role else "received"
        for t, size in self.streams[end].take_discards():
            self.marks.discarded(t, direction, size)

    def _take(self, end: End, tables: Mapping[str, Any]) -> None:
        self._mark_discards(end)
        self.history.beside = sum(stream.held_bytes for stream in self.streams.values())
        with self._lock:
            stream = self.streams[end]
            if end == End.HOST:
                self.mcu_deadlines.sent(tables, lambda name, row: _fields(stream, name, tables[name], row))
            for name, table in tables.items():
                offset = int(table["offset"][-1])
                raw = stream.raw(offset, int(table["size"][-1]))
                self._newest[end, name] = Newest(float(table["t"][-1]), offset, raw)
                if name in self._replies and end == End.HOST:
                    reply = self._replies[name]
                    self.round_trips.ask(reply, table["t"])
                    if self._told[End.MCU]:
                        index = self.codec.tables.indices[reply]
                        self._asked += [(t, index) for t in table["t"].tolist()]
                elif end == End.MCU:
                    self.round_trips.answer(name, table["t"])
                if name in self._log_names:
                    self._note_logs(stream, name, table)
        self.history.add(end, tables)  # last: who sees that a message is counted finds its newest frame

    def _expected(self, times: Sequence[float]) -> list[tuple[int, int]]:
        """Return which reply was requested before which of these reads."""
        asked, self._asked = self._asked, []
        return [(int(np.searchsorted(np.asarray(times), t)), index) for t, index in sorted(asked)]

    def _note_logs(self, stream: Stream, name: str, table: Mapping[str, Any]) -> None:
        for t, offset, size in zip(table["t"].tolist(), table["offset"].tolist(), table["size"].tolist(), strict=True):
            if not self._log_limit.passes(t):
                continue
            message = stream.message(stream.raw(offset, size), name, t)
            line = None if message is None else self.codec.log_line(message)
            if line is not None:
                self.happenings.add(LinkEvent(t, "log", {"level": str(line.level), "text": line.text, "message": name}))

    # ---- out

    def kept(self, end: End, seconds: float) -> Reads:
        """Return the bytes of this end that came in the last seconds, as far as they are kept."""
        with self._lock:
            data, ends, times = self.streams[end].kept(seconds)
        return Reads(data, ends, times, [], None)

    def newest(self, end: End, name: str) -> Newest | None:
        """Return the newest frame of this message, with its message."""
        with self._lock:
            found = self._newest.get((end, name))
            if found is not None and found.message is None:
                found.message = self.streams[end].message(found.raw, name, found.t)
            return found

    def heard(self, end: End) -> float | None:
        """Return the time of the newest frame of this end, or None."""
        with self._lock:
            return max((found.t for (of, _), found in self._newest.items() if of == end), default=None)

    def newest_until(self, end: End, name: str, until: float) -> Newest | None:
        """Return the same up to this time, if the bytes are kept."""
        with self._lock:
            stream = self.streams[end]
            entries = stream.newest(1, name, False, until)
            if not entries:
                return None
            found = Newest(entries[0].t, entries[0].offset, entries[0].bytes)
            found.message = stream.message(found.raw, name, found.t)
            return found

    def entries(
        self, most: int, name: str | None, with_discards: bool, until: float | None = None
    ) -> list[tuple[End, Entry, Message | None]]:
        """Return the last frames, and the bytes between frames, of both ends in the order of time."""
        with self._lock:
            if is_raw(self.codec):
                reads = [(end, entry) for end in ENDS for entry in self.streams[end].reads(most)]
                return [(end, entry, None) for end, entry in sorted(reads, key=lambda one: one[1].t)[-most:]]
            found = [
                (end, entry) for end in ENDS for entry in self.streams[end].newest(most, name, with_discards, until)
            ]
            found.sort(key=lambda one: one[1].t)
            return [
                (end, entry, self.streams[end].message(entry.bytes, entry.name, entry.t) if entry.name else None)
                for end, entry in found[-most:]
            ]


def _fields(stream: Stream, name: str, table: Mapping[str, Any], row: int) -> Mapping[str, Any] | None:
    """Return the fields of a frame whose bytes are still kept."""
    raw = stream.raw(int(table["offset"][row]), int(table["size"][row]))
    message = stream.message(raw, name, float(table["t"][row]))
    return None if message is None else message.fields
