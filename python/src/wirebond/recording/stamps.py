"""The MCU's time stamps in a recording: its clock, from the recorded exchanges of the clock service."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wirebond.codec import Codec, Columns, Table
from wirebond.errors import UsageError
from wirebond.link.clock_line import ClockLine, HostTime
from wirebond.link.clock_sync import ClockSync
from wirebond.link.stamps import MOST_AGE, on_line
from wirebond.protocol.model import End, Field
from wirebond.protocol.stamps import count_us, stamp_of


class RecordedClock:
    """The state of the MCU's clock at each time of a recording: by the exchanges up to then, as a link knows it.

    :param tables: all messages of one end, those of the clock service at least.
    """

    def __init__(self, codec: Codec, tables: Callable[[End], Mapping[str, Table]]) -> None:
        self._codec = codec
        self._tables = tables
        self._known: tuple[NDArray[np.float64], list[ClockLine]] | None = None

    def __call__(self, mcu_us: int, near: float, wrap_us: int) -> HostTime | None:
        """See ``stamps.ToHost``."""
        times, lines = self._lines()
        place = int(np.searchsorted(times, near, side="right")) - 1
        return None if place < 0 else on_line(lines[place], mcu_us, near, wrap_us)

    def stamped(self, columns: Columns) -> Columns:
        """Add the stamps of each message that has one, NaN if they are not known."""
        tables = dict(columns.tables)
        for name, table in tables.items():
            if name == "unknown" or (stamp := stamp_of(self._codec.model.message(name))) is None:
                continue
            stamps, errors = self.stamps(table, stamp)
            tables[name] = replace(table, stamp=stamps, stamp_error=errors)
        return replace(columns, tables=tables)

    def stamps(self, table: Table, stamp: Field) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return when the values of each row were measured, and the maximum error; NaN: unknown."""
        assert table.t is not None
        step = count_us(stamp)
        column = np.asarray(table[stamp.name])
        counts = np.rint(column / float(stamp.scale)) if stamp.is_scaled else column
        raw = (counts.astype(np.uint64) * np.uint64(step) & np.uint64(0xFFFFFFFF)).astype(np.int64)
        times, lines = self._lines()
        places = np.searchsorted(times, table.t, side="right") - 1
        found = np.full(len(table), np.nan)
        errors = np.full(len(table), np.nan)
        for place in np.unique(places[places >= 0]).tolist():
            mine = (places == place) & (table.t >= lines[place].began)
            t, error = _on_line(lines[place], raw[mine], table.t[mine], step << stamp.width)
            is_believed = (t - error <= table.t[mine]) & (table.t[mine] <= t + MOST_AGE)
            found[mine] = np.where(is_believed, t, np.nan)
            errors[mine] = np.where(is_believed, error + step * 1e-6, np.nan)
        return found, errors

    def _lines(self) -> tuple[NDArray[np.float64], list[ClockLine]]:
        """Return the clock after each exchange, and from when on it is valid."""
        if self._known is None:
            times: list[float] = []
            lines: list[ClockLine] = []
            for t, line in self._follow():
                times.append(t)
                lines.append(line)
            self._known = np.maximum.accumulate(np.array(times)) if times else np.zeros(0), lines
        return self._known

    def _follow(self) -> list[tuple[float, ClockLine]]:
        service = self._codec.model.service("clock")
        if service is None:
            return []
        names = dict(service.messages)
        asked, answered = (self._tables(end).get(names[role]) for end, role in _ROLES)
        if asked is None or answered is None or asked.t is None or answered.t is None:
            return []
        widths = {f.name: f.width for f in self._codec.model.message(names["reply"]).fields}
        try:
            sync = ClockSync(min(widths["received_us"], widths["sent_us"]))
        except UsageError:  # it wraps too soon
            return []
        sent = dict(zip(_numbers(asked["host_us"]), asked.t.tolist(), strict=True))
        replies = zip(*(_numbers(answered[name]) for name in _TIMES), answered.t.tolist(), strict=True)
        found = []
        for host_us, received_us, sent_us, back in replies:
            began = sent.pop(host_us, None)
            if began is None or back < began:
                continue
            sync.feed(began, received_us, sent_us, back)
            if sync.line is not None:
                found.append((back, sync.line))
        return found


_ROLES = ((End.HOST, "request"), (End.MCU, "reply"))
_TIMES = ("host_us", "received_us", "sent_us")


def _numbers(column: Any) -> list[int]:
    return [int(value) for value in column]


def _on_line(
    line: ClockLine, raw: NDArray[np.int64], near: NDArray[np.float64], wrap_us: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Convert many times at once, as ``on_line``."""
    newest, wrap = line.segments[-1], min(line.modulus, wrap_us)
    expected = np.rint((line.last.mcu + (near - line.last.host) / newest.slope) * 1e6).astype(np.int64)
    mcu = (expected + (raw - expected + wrap // 2) % wrap - wrap // 2) * 1e-6
    starts = np.array([s.start for s in line.segments])
    of = np.maximum(np.searchsorted(starts, mcu, side="right") - 1, 0)
    each = {name: np.array([getattr(s, name) for s in line.segments])[of] for name in vars(newest)}
    left = each["behind"] * np.clip(1.0 - (mcu - each["start"]) / each["slew"], 0.0, 1.0)
    t = each["host"] + (mcu - each["mcu"]) * each["slope"] - left
    on_newest = newest.host + (mcu - newest.mcu) * newest.slope
    bounds = [abs(s.host - newest.line(s.mcu)) + s.half + line.drift_error * np.abs(mcu - s.mcu) for s in line.best]
    return t, np.minimum.reduce(bounds) + np.abs(t - on_newest)
