"""A column of a track as a plot wants it: least and greatest per pixel, with gaps. No thread, no clock."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wirebond.history.track import Array, Track

GAP = 3.0  # intervals of a message, after which its absence is a gap
_WIDE = frozenset("iuf")


@dataclass(frozen=True)
class Pixels:
    """Rows of equal length: the time of a pixel's first sample, its least and its greatest value. NaN: a gap."""

    t: NDArray[np.float64]
    low: Array
    high: Array


def shown_type(kept: np.dtype[Any]) -> np.dtype[Any]:
    """How values of a column are given: the smaller float that holds them."""
    is_wide = kept.kind in _WIDE and kept.itemsize > (4 if kept.kind == "f" else 2)
    return np.dtype("<f8" if is_wide else "<f4")


def pixels_of(
    track: Track, column: str, begin: float, end: float, width: float, breaks: Sequence[float] = ()
) -> Pixels:
    """The samples from ``begin`` to ``end``, both included. Pixels are ``width`` seconds and lie at multiples of it:
    two calls with one width have the same pixels.

    :param breaks: when the line went away, rising.
    """
    first = int(np.floor(begin / width))
    edges = np.arange(first, int(np.floor(end / width)) + 2) * width
    edges[0] = max(edges[0], begin) if begin > edges[0] else edges[0]
    edges[-1] = np.nextafter(end, np.inf)
    parts: list[tuple[Array, ...]] = []
    for chunk in track.chunks_from(float(edges[0])):
        t = chunk.t
        places = np.searchsorted(t, edges)
        has = np.flatnonzero(places[1:] > places[:-1])
        if not len(has):
            continue
        bounds = np.append(places[:-1][has], places[1:][has[-1]])
        low, high = chunk.least_and_greatest(column, bounds)
        parts.append((has, t[bounds[:-1]], t[bounds[1:] - 1], low, high))
    shown = shown_type(track.types[column])
    if not parts:
        nothing = np.empty(0, shown)
        return Pixels(np.empty(0), nothing, nothing)
    return _with_gaps(_joined(parts), track.interval, breaks, shown)


def _joined(parts: list[tuple[Array, ...]]) -> tuple[Array, ...]:
    """A pixel that lies in two chunks is one."""
    if len(parts) == 1:
        return parts[0]
    pixel, first, last, low, high = (np.concatenate(column) for column in zip(*parts, strict=True))
    starts = np.flatnonzero(np.diff(pixel, prepend=-1))
    stops = np.append(starts[1:], len(pixel)) - 1
    return pixel[starts], first[starts], last[stops], np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)


def _with_gaps(
    found: tuple[Array, ...], interval: float | None, breaks: Sequence[float], shown: np.dtype[Any]
) -> Pixels:
    _, first, last, low, high = found
    is_gap = np.zeros(len(first) - 1, bool)
    if interval is not None:
        is_gap = first[1:] - last[:-1] > GAP * interval
    for t in breaks[bisect_left(breaks, float(first[0])) : bisect_left(breaks, float(first[-1])) + 1]:
        place = int(np.searchsorted(first, t))
        if 0 < place < len(first) and last[place - 1] <= t:
            is_gap[place - 1] = True
    low, high = low.astype(shown), high.astype(shown)
    where = np.flatnonzero(is_gap) + 1
    if not len(where):
        return Pixels(first, low, high)
    between = np.nextafter(last[where - 1], np.inf)
    return Pixels(np.insert(first, where, between), np.insert(low, where, np.nan), np.insert(high, where, np.nan))
