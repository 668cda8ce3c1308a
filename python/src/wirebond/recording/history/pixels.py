"""A column of a track as a plot wants it: least and greatest per pixel, with gaps. No thread, no clock."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wirebond.recording.history.track import Array, Track

GAP = 3.0  # intervals of a message, after which its absence is a gap
BURST = 1 / 8  # of a silence: bytes so soon after it were sent during it, and waited in an adapter or a buffer
_WIDE = frozenset("iuf")


@dataclass(frozen=True)
class Pixels:
    """Rows of equal length: the time of a pixel's first sample, its least and its greatest value. NaN: a gap.

    :ivar open: the time of the first row that later samples may change; or, if there is a gap after it, of the
        last row before that.
    """

    t: NDArray[np.float64]
    low: Array
    high: Array
    open: float = np.nan


def shown_type(kept: np.dtype[Any]) -> np.dtype[Any]:
    """Return the type for values of a column: the smallest float that holds them."""
    is_wide = kept.kind in _WIDE and kept.itemsize > (4 if kept.kind == "f" else 2)
    return np.dtype("<f8" if is_wide else "<f4")


def pixels_of(
    track: Track, columns: Sequence[str], begin: float, end: float, width: float, breaks: Sequence[float] = ()
) -> list[Pixels]:
    """Return the samples of each column from ``begin`` to ``end``, both included. Pixels are ``width`` seconds and lie
    at multiples of it: two calls with one width have the same pixels.

    :param breaks: when the line went away, rising.
    """
    first = int(np.floor(begin / width))
    edges = np.arange(first, int(np.floor(end / width)) + 2) * width
    edges[0] = max(edges[0], begin) if begin > edges[0] else edges[0]
    edges[-1] = np.nextafter(end, np.inf)
    parts: list[_Part] = []
    for chunk in track.chunks_from(float(edges[0])):
        t = chunk.t
        places = np.searchsorted(t, edges)
        has = np.flatnonzero(places[1:] > places[:-1])
        if not len(has):
            continue
        bounds = np.append(places[:-1][has], places[1:][has[-1]])
        extremes = chunk.least_and_greatest(columns, bounds)
        parts.append(_Part(has, t[bounds[:-1]], t[bounds[1:] - 1], extremes))
    shown = [shown_type(track.types[column]) for column in columns]
    if not parts:
        return [Pixels(np.empty(0), np.empty(0, of), np.empty(0, of)) for of in shown]
    whole = _joined(parts)
    gaps = _gaps(whole, track, breaks)
    t = gaps.inserted(whole.first, gaps.between)
    return [
        Pixels(t, gaps.inserted(low.astype(of)), gaps.inserted(high.astype(of)), gaps.open)
        for (low, high), of in zip(whole.extremes, shown, strict=True)
    ]


class _Part(NamedTuple):
    """Pixels that have samples: which they are, the times of their first and last samples, and of each column the least
    and the greatest values."""

    pixel: Array
    first: NDArray[np.float64]
    last: NDArray[np.float64]
    extremes: list[tuple[Array, Array]]


class _Gaps(NamedTuple):
    """Before which pixels nothing came for too long, and a time in between; ``open`` of `Pixels`."""

    where: NDArray[np.intp]
    between: NDArray[np.float64]
    open: float

    def inserted(self, values: Array, what: Array | float = np.nan) -> Array:
        return np.insert(values, self.where, what) if len(self.where) else values


def _joined(parts: list[_Part]) -> _Part:
    """Return a pixel that lies in two chunks is one."""
    if len(parts) == 1:
        return parts[0]
    pixel = np.concatenate([part.pixel for part in parts])
    starts = np.flatnonzero(np.diff(pixel, prepend=-1))
    stops = np.append(starts[1:], len(pixel)) - 1
    extremes = []
    for column in zip(*(part.extremes for part in parts), strict=True):
        low, high = (np.concatenate(values) for values in zip(*column, strict=True))
        extremes.append((np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)))
    first, last = (np.concatenate(times) for times in zip(*((p.first, p.last) for p in parts), strict=True))
    return _Part(pixel[starts], first[starts], last[stops], extremes)


def _gaps(found: _Part, track: Track, breaks: Sequence[float]) -> _Gaps:
    first, last = found.first, found.last
    is_gap = np.zeros(len(first) - 1, bool)
    open_from = float(first[-1])
    if track.interval is not None:
        silent = first[1:] - last[:-1]
        is_gap = silent > GAP * track.interval
        places = np.flatnonzero(is_gap)
        if len(places):
            back, silent = first[places + 1], silent[places]
            until = back + BURST * silent
            is_gap[places] = silent > (GAP - 1 + track.counts(back, until)) * track.interval
            undecided = places[until > (track.last or 0.0)]
            if len(undecided):
                open_from = float(first[undecided[0]])
    for t in breaks[bisect_left(breaks, float(first[0])) : bisect_left(breaks, float(first[-1])) + 1]:
        place = int(np.searchsorted(first, t))
        if 0 < place < len(first) and last[place - 1] <= t:
            is_gap[place - 1] = True
    where = np.flatnonzero(is_gap) + 1
    return _Gaps(where, np.nextafter(last[where - 1], np.inf), open_from)
