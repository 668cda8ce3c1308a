"""Batches of a plot as bytes: what is new since the last one, least and greatest per pixel. No socket."""

from __future__ import annotations

import json
import math
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wirebond.console.wants import Plot
from wirebond.recording.history.history import History
from wirebond.recording.history.pixels import Pixels

_ALIGNED = 8
_LENGTH = struct.Struct("<I")


@dataclass
class _Sent:
    """The sent part of one field: where the first pixel begins that may still change, and the rows from there on."""

    begin: float
    rows: bytes


@dataclass
class PlotFeed:
    """The state of one plot at one client."""

    plot: Plot
    _sent: dict[str, _Sent] = field(default_factory=dict)
    _is_first: bool = True
    _newest: float = -math.inf  # newest time of a fixed range when it was read

    def batch(self, history: History, now: float) -> bytes | None:
        """Return what the client lacks; None: nothing.

        :raises UsageError: one of the fields cannot be plotted.
        """
        plot = self.plot
        if plot.seconds is not None:
            return self._between(history, now, now - plot.seconds, now)
        begin, end = plot.begin or 0.0, plot.to or 0.0
        kept = history.range()
        newest = -math.inf if kept is None else min(kept[1], end)
        if newest == self._newest and not self._is_first:
            return None
        self._newest = newest
        return self._between(history, now, begin, end)

    def _between(self, history: History, now: float, begin: float, end: float) -> bytes | None:
        plot, is_first = self.plot, self._is_first
        width = (end - begin if plot.seconds is None else plot.seconds) / plot.pixels
        begins: dict[float, list[str]] = {}
        for name in plot.fields:
            begins.setdefault(self._sent[name].begin if name in self._sent else begin, []).append(name)
        found: dict[str, Pixels] = {}
        for since, names in begins.items():
            found.update(zip(names, history.pixels(names, since, end, width), strict=True))
        columns = []
        for name in plot.fields:
            sent, pixels = self._sent.get(name), found[name]
            if not len(pixels.t):
                continue
            if sent is not None and _rows_from(pixels, pixels.t[0]) == sent.rows:
                continue
            open_from = max(math.floor(pixels.open / width) * width, begin)
            self._sent[name] = _Sent(open_from, _rows_from(pixels, pixels.open))
            columns.append((name, pixels))
        self._is_first = False
        if not columns and not is_first:
            return None
        head = {"plot": plot.id, "now": now, "from": begin, "to": end, "width": width, "replace": is_first}
        return packed(head, columns)


def _rows_from(pixels: Pixels, t: float) -> bytes:
    place = int(np.searchsorted(pixels.t, t))
    return b"".join(column[place:].tobytes() for column in (pixels.t, pixels.low, pixels.high))


def packed(head: dict[str, Any], columns: list[tuple[str, Pixels]]) -> bytes:
    """Return a batch as docs/console-api.md has it."""
    head["columns"] = []
    arrays = []
    for field_name, pixels in columns:
        kind = "f64" if pixels.low.dtype.itemsize == 8 else "f32"
        head["columns"].append({"field": field_name, "n": len(pixels.t), "t": "f64", "low": kind, "high": kind})
        arrays += [pixels.t, pixels.low, pixels.high]
    text = json.dumps(head).encode()
    text += b" " * (-(len(text) + _LENGTH.size) % _ALIGNED)
    parts = [_LENGTH.pack(len(text)), text]
    for array in arrays:
        data = np.ascontiguousarray(array).tobytes()
        parts += [data, bytes(-len(data) % _ALIGNED)]
    return b"".join(parts)
