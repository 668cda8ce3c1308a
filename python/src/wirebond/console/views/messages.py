"""The newest of each message."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
import numpy as np

from wirebond.as_json import plain
from wirebond.console.views.view import Scene, SourceView
from wirebond.link.raw import is_raw
from wirebond.protocol.model import End, Field
from wirebond.recording.history.source import Newest, Source
from wirebond.recording.history.told import message_dict

SPARKS_EVERY = 0.5  # seconds
SPARK_SECONDS, SPARK_POINTS = 20.0, 40
_LEAST_WINDOW = 2.0  # seconds in which a rate is counted
_SHORTEST_WINDOW = 0.25  # of a message that has just begun to come
_WINDOW_INTERVALS = 5.0


class Messages(msgspec.Struct):
    """The table of messages."""

    every: Annotated[float, msgspec.Meta(ge=0.05, le=60)] = 0.1


class MessagesView(SourceView[Messages]):
    wish = Messages

    def __init__(self, wish: Messages) -> None:
        super().__init__(wish)
        self._next_sparks = 0.0
        self._sent: object = None  # shows whether anything has changed

    def look(self, source: Source, scene: Scene) -> dict[str, Any] | None:
        if not self._is_due(scene.now, self.wanted.every):
            return None
        with_sparks = scene.now >= self._next_sparks
        if with_sparks:
            self._next_sparks = scene.now + SPARKS_EVERY
        rows = message_rows(source, scene.shown, at=scene.at, with_sparks=with_sparks)
        marks = [(row["t"], row["count"], round(row["rate"], 1)) for row in rows]
        if self._sent == marks and (scene.at is not None or not with_sparks):
            return None
        self._sent = marks
        return {"t": scene.shown, "rows": rows}


def message_rows(source: Source, now: float, *, at: float | None, with_sparks: bool) -> list[dict[str, Any]]:
    """Return one row for each message and each end that may send it.

    :param at: of a recording: the time that is shown.
    """
    if is_raw(source.codec):
        return []
    return [_row(source, end, name, now, at, with_sparks) for end, name in source.history.tracks()]


def _row(source: Source, end: End, name: str, now: float, at: float | None, with_spark: bool) -> dict[str, Any]:
    history = source.history
    interval = history.interval(end, name)
    window = max(_LEAST_WINDOW, _WINDOW_INTERVALS * (interval or 0.0))
    first = history.first(end, name)
    if first is not None:  # it began within the window: the counts are of this time alone
        window = min(window, max(now - first, interval or 0.0, _SHORTEST_WINDOW))
    came = history.count_between(end, name, now - window, np.inf if at is None else np.nextafter(at, np.inf))
    row: dict[str, Any] = {
        "name": name,
        "sender": end.value,
        "count": history.count(end, name) if at is None else history.count_between(end, name, -np.inf, at),
        "t": None,
        "rate": came / window,
        "due": None if interval is None else 1 / interval,
    }
    newest = source.newest(end, name) if at is None else source.newest_until(end, name, at)  # after the counts
    if newest is not None:
        row |= _newest(newest)
    if with_spark and (column := _spark_column(source, end, name)) is not None:
        edges = np.linspace(now - SPARK_SECONDS, now, SPARK_POINTS + 1)
        points = history.samples(end, name, column, edges)
        if not np.isnan(points).all():
            row["spark"] = {"field": column, "values": plain(points.tolist())}
    return row


def _newest(newest: Newest) -> dict[str, Any]:
    found: dict[str, Any] = {"t": newest.t, "bytes": newest.raw.hex()}
    return found if newest.message is None else found | message_dict(newest.message)


def _spark_column(source: Source, end: End, name: str) -> str | None:
    """Return the first column of a plain number; else the first one that is not a time stamp."""
    fields = source.codec.model.message(name).fields
    stamps = {f.name for f in fields if f.clock is not None}
    columns = [c for c in source.history.columns(end, name) if c not in stamps]
    numbers = {f.name for f in fields if _is_number(f)}
    return next((c for c in columns if c.partition("[")[0] in numbers), columns[0] if columns else None)


def _is_number(field: Field) -> bool:
    return field.is_number and not field.enum and not field.flags
