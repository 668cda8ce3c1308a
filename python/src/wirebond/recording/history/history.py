"""The tracks of both ends in bounded memory: what plots, tables and step tests read. Any thread."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wirebond.errors import UsageError
from wirebond.protocol.model import End, Field, Protocol
from wirebond.recording.history.pixels import Pixels, pixels_of, shown_type
from wirebond.recording.history.track import Array, Track

MOST_BYTES = 256 << 20
_INDEX = re.compile(r"\[(\d+)\]")  # of an element in the name of its column
_MOST_ELEMENTS = 64  # of an array that is kept element by element
_NARROW = 16  # bits of a scaled whole number, whose values a small float holds


class History:
    """:param most: bytes that are kept of all messages; the oldest go first. None: all.
    :param tables: of each end, all messages without rows: they define the columns.
    :ivar beside: bytes that are kept beside the rows, and count in.
    """

    def __init__(self, model: Protocol, tables: Mapping[End, Mapping[str, Any]], most: int | None = MOST_BYTES) -> None:
        self._most = most
        self.beside = 0
        self._lock = threading.Lock()
        self._tracks: dict[tuple[End, str], Track] = {}
        self._whole: dict[tuple[End, str], list[tuple[str, str, int]]] = {}  # column, its field, the element or -1
        self._whose: dict[str, list[End]] = {}
        self._breaks: list[float] = []
        messages = {m.name: m for m in model.messages}
        for end, of_end in tables.items():
            for name, table in of_end.items():
                message = messages.get(name)
                if message is None or not message.sent_by(end):
                    continue
                every = message.every
                if every is None:  # replies to periodic requests come with their period
                    every = next((m.every for m in model.messages if m.reply == name and m.every is not None), None)
                self._add_track(end, name, table["fields"], message.fields, every)

    def _add_track(
        self, end: End, name: str, columns: Mapping[str, Any], fields: tuple[Field, ...], every: float | None
    ) -> None:
        narrow = set(_narrow(fields, ""))
        types: dict[str, np.dtype[Any]] = {}
        sources = []
        for column, values in columns.items():
            if isinstance(values, list) or any(int(i) >= _MOST_ELEMENTS for i in _INDEX.findall(column)):
                continue
            kept = np.dtype(np.uint8) if values.dtype == bool else values.dtype
            if _INDEX.sub("", column) in narrow and kept == np.float64:
                kept = np.dtype(np.float32)
            if values.ndim == 1:
                types[column] = kept
                sources.append((column, column, -1))
            elif values.shape[1] <= _MOST_ELEMENTS:
                for i in range(values.shape[1]):
                    types[f"{column}[{i}]"] = kept
                    sources.append((f"{column}[{i}]", column, i))
        self._tracks[end, name] = Track(types, every)
        self._whole[end, name] = sources
        self._whose.setdefault(name, []).append(end)

    # ---- in

    def add(self, end: End, tables: Mapping[str, Any]) -> None:
        """Add rows of one end that are newer than all of that end."""
        with self._lock:
            for name, table in tables.items():
                track = self._tracks.get((end, name))
                if track is None:
                    continue
                fields = table["fields"]
                columns = {
                    column: fields[source] if element < 0 else fields[source][:, element]
                    for column, source, element in self._whole[end, name]
                }
                track.append(table["t"], columns)
            self._make_room()

    def add_break(self, t: float) -> None:
        """Note that the line went away at this time."""
        with self._lock:
            self._breaks.append(t)
            del self._breaks[:-10_000]

    def _make_room(self) -> None:
        while self._most is not None and self._bytes() > self._most:
            droppable = [track for track in self._tracks.values() if len(track.chunks) > 1]
            if not droppable:
                return
            min(droppable, key=lambda track: track.first or 0.0).drop_oldest()

    # ---- out

    @property
    def bytes(self) -> int:
        """The memory that all of it takes."""
        with self._lock:
            return self._bytes()

    def _bytes(self) -> int:
        return self.beside + sum(track.bytes for track in self._tracks.values())

    @property
    def most(self) -> int | None:
        """The maximum memory."""
        return self._most

    def range(self) -> tuple[float, float] | None:
        """Return the times of the oldest and the newest row; None: there is none."""
        with self._lock:
            tracks = [track for track in self._tracks.values() if track.chunks]
            if not tracks:
                return None
            return min(track.first or 0.0 for track in tracks), max(track.last or 0.0 for track in tracks)

    def tracks(self) -> list[tuple[End, str]]:
        """End and message of every track."""
        return list(self._tracks)

    def columns(self, end: End, name: str) -> list[str]:
        """Return the columns of a message, as they are kept."""
        track = self._tracks.get((end, name))
        return [] if track is None else list(track.types)

    def count(self, end: End, name: str) -> int:
        """Return how many of this message ever arrived."""
        track = self._tracks.get((end, name))
        return 0 if track is None else track.count

    def count_between(self, end: End, name: str, begin: float, end_time: float) -> int:
        """Return how many of the kept ones have a time from ``begin`` on, and before ``end_time``."""
        with self._lock:
            return self._tracks[end, name].count_between(begin, end_time)

    def first(self, end: End, name: str) -> float | None:
        """Return the time of the oldest kept message, or None."""
        with self._lock:
            return self._tracks[end, name].first

    def interval(self, end: End, name: str) -> float | None:
        """Return the seconds between two of them, if the file says so."""
        return self._tracks[end, name].interval

    def samples(self, end: End, name: str, column: str, edges: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the last value between each two neighbours of ``edges``; NaN where there is none."""
        with self._lock:
            return self._tracks[end, name].samples(column, edges)

    def find(self, field: str) -> tuple[End, str, str]:
        """End, message and column of a field's name, such as ``status.battery`` or ``host:ping.number``.

        :raises UsageError: there is no such field, or it cannot be plotted.
        """
        given, _, rest = field.rpartition(":")
        name, _, column = rest.partition(".")
        ends = self._whose.get(name, [])
        if given:
            ends = [end for end in ends if end.value == given]
        if not ends:
            raise UsageError(f"{field!r:.80} names no message of this protocol; it has {', '.join(self._whose)}")
        end = End.MCU if End.MCU in ends else ends[0]
        types = self._tracks[end, name].types
        if column not in types:
            raise UsageError(
                f"{field!r:.80}: {name} has no field {column!r:.80} that can be plotted; it has "
                f"{', '.join(types) or 'none'}"
            )
        return end, name, column

    def pixels(self, fields: Sequence[str], begin: float, end: float, width: float) -> list[Pixels]:
        """Return minimum and maximum of each field from ``begin`` to ``end``, in pixels of ``width`` seconds. Fields of
        one message cost less together.

        :raises UsageError: there is no such field.
        """
        of_tracks: dict[tuple[End, str], list[tuple[str, str]]] = {}
        for field in fields:
            whose, name, column = self.find(field)
            of_tracks.setdefault((whose, name), []).append((field, column))
        found: dict[str, Pixels] = {}
        with self._lock:
            for key, wanted in of_tracks.items():
                columns = [column for _, column in wanted]
                pixels = pixels_of(self._tracks[key], columns, begin, end, width, self._breaks)
                found.update(zip([field for field, _ in wanted], pixels, strict=True))
        return [found[field] for field in fields]

    def rows(self, field: str) -> tuple[NDArray[np.float64], Array]:
        """Return all kept rows of a field: times and values.

        :raises UsageError: there is no such field.
        """
        whose, name, column = self.find(field)
        with self._lock:
            chunks = self._tracks[whose, name].chunks
            if not chunks:
                return np.empty(0), np.empty(0, self._tracks[whose, name].types[column])
            return np.concatenate([c.t for c in chunks]), np.concatenate([c.column(column) for c in chunks])

    def rows_between(
        self, end: End, name: str, columns: Iterable[str], begin: float = -np.inf, end_time: float = np.inf
    ) -> tuple[NDArray[np.float64], dict[str, Array]]:
        """Return times and columns of a message's rows from ``begin`` to ``end_time``, both included, as far as they
        go."""
        with self._lock:
            track = self._tracks[end, name]
            parts = []
            for chunk in track.chunks_from(begin):
                low = int(np.searchsorted(chunk.t, begin))
                high = int(np.searchsorted(chunk.t, end_time, side="right"))
                parts.append((chunk, slice(low, high)))
            t = np.concatenate([np.empty(0), *(chunk.t[rows] for chunk, rows in parts)])
            return t, {
                column: np.concatenate(
                    [np.empty(0, track.types[column]), *(chunk.column(column)[rows] for chunk, rows in parts)]
                )
                for column in columns
            }

    def type_of(self, field: str) -> np.dtype[Any]:
        """Return the type of this field's values in `pixels`.

        :raises UsageError: there is no such field.
        """
        whose, name, column = self.find(field)
        return shown_type(self._tracks[whose, name].types[column])


def _narrow(fields: tuple[Field, ...], prefix: str) -> Iterable[str]:
    """Yield the columns of scaled numbers of few bits."""
    for field in fields:
        if field.fields:
            yield from _narrow(field.fields, f"{prefix}{field.name}.")
        elif field.is_scaled and not field.is_float and field.width <= _NARROW:
            yield f"{prefix}{field.name}"
