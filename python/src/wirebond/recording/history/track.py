"""Rows of one message of one end, in the order of time: chunks of columns. No thread, no clock, no protocol."""

from __future__ import annotations

import mmap
import sys
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROWS = 1 << 16  # of a whole chunk
BLOCK = 1 << 8  # rows whose least and greatest value a whole chunk knows
_FIRST_ROWS = 1 << 8
_MAPPED = 1 << 17  # bytes from which on memory is mapped
_PRIVATE: dict[str, Any]
if sys.platform == "win32":
    _PRIVATE = {}
else:
    _PRIVATE = {"flags": mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS}
OF_ARRAY = 256  # bytes that Python and numpy take for an array beside its values
Array = NDArray[Any]


class Chunk:
    """Rows that are dropped together. It grows up to `ROWS`; whole, it knows the extremes of its blocks.

    :ivar rows: how many there are.
    :ivar bytes: of memory that it takes.
    """

    def __init__(self, types: Mapping[str, np.dtype[Any]]) -> None:
        self.rows = 0
        self._types = types
        self._hold(_FIRST_ROWS)

    def _hold(self, size: int) -> None:
        """Allocate memory for so many rows, and keep the present ones. It is one piece: each of many would be rounded
        up, and leave a hole when it is replaced by a longer one."""
        is_whole = size == ROWS
        wanted = [(np.dtype(np.float64), size), *((of, size) for of in self._types.values())]
        if is_whole:
            wanted += [(of, ROWS // BLOCK) for of in self._types.values() for _ in range(2)]
        arrays = _in_one_piece(wanted)
        self.bytes = sum(array.nbytes for array in arrays) + OF_ARRAY * len(arrays)
        each = iter(arrays)
        t, columns = next(each), {name: next(each) for name in self._types}
        if self.rows:
            t[: self.rows] = self.t
            for name, column in columns.items():
                column[: self.rows] = self.column(name)
        self._t: NDArray[np.float64] = t
        self._columns = columns
        self._extremes = {name: (next(each), next(each)) for name in self._types} if is_whole else {}

    @property
    def is_whole(self) -> bool:
        return self.rows == ROWS

    @property
    def t(self) -> NDArray[np.float64]:
        return self._t[: self.rows]

    def column(self, name: str) -> Array:
        return self._columns[name][: self.rows]

    def append(self, t: NDArray[np.float64], columns: Mapping[str, Array], begin: int) -> int:
        """Take rows from ``begin`` on, as many as there is room for. Where the next one is."""
        count = min(len(t) - begin, ROWS - self.rows)
        self._reserve(self.rows + count)
        here = slice(self.rows, self.rows + count)
        self._t[here] = t[begin : begin + count]
        for name, column in self._columns.items():
            column[here] = columns[name][begin : begin + count]
        self.rows += count
        if self.is_whole:
            for name, (low, high) in self._extremes.items():
                blocks = self._columns[name].reshape(-1, BLOCK)
                np.fmin.reduce(blocks, axis=1, out=low)
                np.fmax.reduce(blocks, axis=1, out=high)
        return begin + count

    def _reserve(self, rows: int) -> None:
        size = len(self._t)
        if rows <= size:
            return
        while size < rows:
            size *= 2
        self._hold(size)

    def least_and_greatest(self, names: Sequence[str], edges: NDArray[np.intp]) -> list[tuple[Array, Array]]:
        """Return minimum and maximum of these columns for the rows between each two neighbours of ``edges``, which
        increase. NaN counts only if there is no other value."""
        if not self.is_whole or edges[-1] - edges[0] < 4 * BLOCK * len(edges):
            starts = edges[:-1] - edges[0]
            parts = [self._columns[name][edges[0] : edges[-1]] for name in names]
            return [(np.fmin.reduceat(part, starts), np.fmax.reduceat(part, starts)) for part in parts]
        unfolding = _Unfolding(edges)
        return [unfolding.least_and_greatest(self._columns[name], *self._extremes[name]) for name in names]


class _Unfolding:
    """One value for each block between the edges, but all rows of the blocks that an edge cuts. The places are the same
    for all columns."""

    def __init__(self, edges: NDArray[np.intp]) -> None:
        first, last = edges[0] // BLOCK, -(-edges[-1] // BLOCK)
        is_cut = np.zeros(last - first + 1, bool)
        is_cut[edges[edges % BLOCK != 0] // BLOCK - first] = True
        at = np.concatenate(([0], np.cumsum(np.where(is_cut, BLOCK, 1))))
        ends = at[edges // BLOCK - first] + edges % BLOCK
        cut, plain = np.flatnonzero(is_cut), np.flatnonzero(~is_cut[:-1])
        self.size = int(at[-1])  # values
        self._starts, self._end = ends[:-1], ends[-1]
        self._cut, self._rows = cut + first, (at[cut][:, None] + np.arange(BLOCK)).ravel()
        self._plain, self._extremes = plain + first, at[plain]

    def least_and_greatest(self, column: Array, low: Array, high: Array) -> tuple[Array, Array]:
        """Compute minimum and maximum between each two neighbours of the edges, out of a column and the extremes of its
        blocks."""
        values = np.empty(self.size, column.dtype)
        values[self._rows] = column.reshape(-1, BLOCK)[self._cut].ravel()
        values[self._extremes] = low[self._plain]
        least = np.fmin.reduceat(values[: self._end], self._starts)
        values[self._extremes] = high[self._plain]
        return least, np.fmax.reduceat(values[: self._end], self._starts)


def _in_one_piece(wanted: Sequence[tuple[np.dtype[Any], int]]) -> list[Array]:
    """Make arrays of such types and lengths side by side: the widest first, so that each begins at a multiple of its
    width."""
    piece = _memory(sum(of.itemsize * size for of, size in wanted))
    found: list[Array] = [piece] * len(wanted)
    at = 0
    for place in sorted(range(len(wanted)), key=lambda place: -wanted[place][0].itemsize):
        of, size = wanted[place]
        found[place] = piece[at : at + of.itemsize * size].view(of)
        at += of.itemsize * size
    return found


def _memory(size: int) -> NDArray[np.uint8]:
    """Allocate so many bytes. Large memory is mapped by itself, and so returns to the system as soon as it is
    dropped."""
    if size < _MAPPED:
        return np.empty(size, np.uint8)
    return np.frombuffer(mmap.mmap(-1, size, **_PRIVATE), np.uint8)


class Track:
    """The kept rows of one message of one end.

    :param types: the columns, and how each is kept.
    :param interval: seconds between two of these messages, where the file says so.
    """

    def __init__(self, types: Mapping[str, np.dtype[Any]], interval: float | None = None) -> None:
        self.types = dict(types)
        self.interval = interval
        self.count = 0  # of all that ever came
        self.chunks: deque[Chunk] = deque()

    @property
    def bytes(self) -> int:
        return sum(chunk.bytes for chunk in self.chunks)

    @property
    def first(self) -> float | None:
        """The time of the oldest row."""
        return float(self.chunks[0].t[0]) if self.chunks else None

    @property
    def last(self) -> float | None:
        """The time of the newest row."""
        return float(self.chunks[-1].t[-1]) if self.chunks else None

    def append(self, t: NDArray[np.float64], columns: Mapping[str, Array]) -> None:
        """Take rows, whose times do not fall."""
        self.count += len(t)
        at = 0
        while at < len(t):
            if not self.chunks or self.chunks[-1].is_whole:
                self.chunks.append(Chunk(self.types))
            at = self.chunks[-1].append(t, columns, at)

    def chunks_from(self, begin: float) -> list[Chunk]:
        """Return the chunks that may hold rows from ``begin`` on, oldest first."""
        found = []
        for chunk in reversed(self.chunks):
            if chunk.t[-1] < begin:
                break
            found.append(chunk)
        return found[::-1]

    def drop_oldest(self) -> None:
        """Forget the oldest chunk."""
        self.chunks.popleft()

    def count_between(self, begin: float, end: float) -> int:
        """Return how many rows have a time from ``begin`` on, and before ``end``."""
        total = 0
        for chunk in reversed(self.chunks):
            low, high = np.searchsorted(chunk.t, (begin, end))
            total += int(high - low)
            if low > 0:
                break
        return total

    def counts(self, begins: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.intp]:
        """Return how many rows have a time from each of ``begins`` to its end, both included. ``begins`` increase."""
        total = np.zeros(len(begins), np.intp)
        for chunk in self.chunks_from(float(begins[0])):
            t = chunk.t
            near = slice(0, int(np.searchsorted(begins, t[-1], side="right")))
            total[near] += np.searchsorted(t, ends[near], side="right") - np.searchsorted(t, begins[near])
        return total

    def samples(self, column: str, edges: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the last value between each two neighbours of ``edges``; NaN where there is none."""
        out = np.full(len(edges) - 1, np.nan)
        for chunk in self.chunks_from(float(edges[0])):
            t = chunk.t
            places = np.searchsorted(t, edges)
            has = places[1:] > places[:-1]
            out[has] = chunk.column(column)[places[1:][has] - 1]
        return out
