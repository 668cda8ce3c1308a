"""Samples of fields as CSV: every one of a range, with units and the times of its message. No socket."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wirebond.codec import Table
from wirebond.protocol.model import End
from wirebond.protocol.stamps import stamp_of
from wirebond.recording.history.source import Source
from wirebond.recording.stamps import RecordedClock

_ROWS = 1 << 14  # written at a time
_Values = NDArray[np.generic]


@dataclass(frozen=True)
class _Part:
    """The samples of one message of one end."""

    message: str
    t: NDArray[np.float64]
    measured: NDArray[np.float64] | None  # by the MCU, on the clock of ``t``; NaN: not known. None: it does not say
    fields: dict[str, _Values]


def csv_of_samples(
    source: Source, fields: Sequence[str], begin: float, end: float, zero: float, *, counts_from_start: bool
) -> Iterator[bytes]:
    """Yield the CSV piece by piece: a row for each message that came from ``begin`` to ``end``, both included.

    :param zero: seconds since 1970 at the time 0 of the source.
    :param counts_from_start: the column ``t`` has the times of the source, else seconds since 1970.
    :raises UsageError: one of the fields cannot be plotted.
    """
    wanted = list(dict.fromkeys(fields))
    parts = _parts(source, wanted, begin, end)
    has_measured = any(part.measured is not None for part in parts)
    times = ["time", "t [s]", *(["measured [s]"] if has_measured else []), "message"]
    header = [*times, *(_with_unit(source, name) for name in wanted)]
    places = {name: len(times) + place for place, name in enumerate(wanted)}
    return _pieces(header, parts, places, zero, 0.0 if counts_from_start else zero)


def _parts(source: Source, wanted: Sequence[str], begin: float, end: float) -> list[_Part]:
    of_messages: dict[tuple[End, str], dict[str, str]] = {}
    for name in wanted:
        whose, message, column = source.history.find(name)
        of_messages.setdefault((whose, message), {})[name] = column
    clock = RecordedClock(source.codec, lambda whose: _clock_tables(source, whose))
    found = []
    for (whose, message), columns in of_messages.items():
        stamp = stamp_of(source.codec.model.message(message)) if whose == End.MCU else None
        needed = {*columns.values(), *([] if stamp is None else [stamp.name])}
        t, values = source.history.rows_between(whose, message, needed, begin, end)
        measured = None
        if stamp is not None:
            measured, _ = clock.stamps(_table(t, {stamp.name: values[stamp.name]}), stamp)
        found.append(_Part(message, t, measured, {name: values[column] for name, column in columns.items()}))
    return found


def _clock_tables(source: Source, whose: End) -> dict[str, Table]:
    """Return all kept results of the clock service."""
    service = source.codec.model.service("clock")
    names = set() if service is None else set(dict(service.messages).values())
    kept = [name for end, name in source.history.tracks() if end == whose and name in names]
    rows = {name: source.history.rows_between(whose, name, source.history.columns(whose, name)) for name in kept}
    return {name: _table(t, values) for name, (t, values) in rows.items()}


def _table(t: NDArray[np.float64], columns: dict[str, _Values]) -> Table:
    return Table(np.zeros(len(t), np.uint64), dict(columns), t)


def _pieces(
    header: list[str], parts: Sequence[_Part], places: dict[str, int], zero: float, shift: float
) -> Iterator[bytes]:
    whose = np.concatenate([np.full(len(part.t), number) for number, part in enumerate(parts)])
    rows = np.concatenate([np.arange(len(part.t)) for part in parts])
    order = np.argsort(np.concatenate([part.t for part in parts]), kind="stable")
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    for begin in range(0, len(order), _ROWS):
        here = order[begin : begin + _ROWS]
        cells: NDArray[np.object_] = np.full((len(here), len(header)), "", object)
        for number, part in enumerate(parts):
            mine = np.flatnonzero(whose[here] == number)
            chosen = rows[here[mine]]
            for place, texts in _cells(part, chosen, places, header.index("message"), zero, shift).items():
                cells[mine, place] = texts
        writer.writerows(cells.tolist())
        yield out.getvalue().encode()
        out.seek(0)
        out.truncate()
    yield out.getvalue().encode()


def _cells(
    part: _Part, rows: NDArray[np.intp], places: dict[str, int], at_message: int, zero: float, shift: float
) -> dict[int, Sequence[object]]:
    """Return the cells of these rows for each column of the file."""
    t = part.t[rows]
    utc = np.round((t + zero) * 1e6).astype(np.int64).astype("datetime64[us]")
    found: dict[int, Sequence[object]] = {
        0: [f"{at}Z" for at in np.datetime_as_string(utc).tolist()],
        1: np.round(t + shift, 6).tolist(),
        at_message: [part.message] * len(rows),
    }
    if part.measured is not None:
        times = np.round(part.measured[rows] + shift, 6).tolist()
        found[2] = ["" if np.isnan(at) else at for at in times]
    for name, values in part.fields.items():
        here = values[rows]
        # a small float as short as it can be: 11.97, not 11.970000267
        found[places[name]] = (here.astype(str) if here.dtype == np.float32 else here).tolist()
    return found


def _with_unit(source: Source, name: str) -> str:
    _, message, column = source.history.find(name)
    field = source.codec.model.message(message).field_at(column)
    return f"{name} [{field.unit}]" if field is not None and field.unit else name
