"""Computes which deadlines at the MCU have struck, from the messages that the host sent. No thread, no clock.

Most MCUs do not say that a deadline has struck. But its rule is in the protocol file, and silence is known at this end,
too. What the MCU did not hear (noise, no power) is not known here, and neither is what came before the link was opened.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wirebond.protocol.given import is_given
from wirebond.protocol.model import Deadline, End, Protocol, Recover, Start

Fields = Callable[[str, int], Mapping[str, Any] | None]  # of a row of a message's table


@dataclass
class _Watch:
    index: int  # of the file's deadlines
    rule: Deadline
    since: float | None = None  # when its silence began; None: not known
    told: float | None = None  # the silence whose strike was reported

    def has_struck(self, now: float) -> bool:
        return self.since is not None and now - self.since >= self.rule.after

    def holds_back(self, now: float) -> bool:
        return self.rule.recover == Recover.EXPLICIT and self.has_struck(now)


class McuDeadlines:
    """:param model: whose deadlines they are. Addresses are not distinguished: frames for one device count for all."""

    def __init__(self, model: Protocol) -> None:
        self._model = model
        self._watches: dict[str, list[_Watch]] = {}  # by the message that they miss
        for index, rule in enumerate(model.deadlines):
            if rule.at == End.MCU:
                self._watches.setdefault(rule.message, []).append(_Watch(index, rule))
        self._all = [watch for watches in self._watches.values() for watch in watches]
        self._strikes: list[tuple[float, Deadline]] = []  # not taken yet
        self._enders = {watch.rule.recover_by.message for watch in self._all if watch.rule.recover_by is not None}

    def sent(self, tables: Mapping[str, Any], fields: Fields) -> None:
        """Take frames of the host, newer than all before: the rows of each message."""
        ends = sorted(
            (t, watch.index)
            for name in self._enders & tables.keys()
            for row, t in enumerate(tables[name]["t"].tolist())
            for watch in self._ended_by(name, fields(name, row))
        )
        for name, watches in self._watches.items():
            times = tables[name]["t"] if name in tables else np.empty(0)
            for t, index in ends:
                for watch in watches:
                    if watch.index == index:
                        before = int(np.searchsorted(times, t))
                        self._act(watches, times[:before])
                        self._recover(watch, watches, t)
                        times = times[before:]
            self._act(watches, times)

    def states(self, now: float) -> list[dict[str, Any]]:
        """Return for each deadline at the MCU its place in the file, and since when it has struck; ``unknown``: none of
        its messages was sent, so events before this link decide."""
        return [
            {
                "deadline": watch.index,
                "since": watch.since + watch.rule.after if watch.since is not None and watch.has_struck(now) else None,
                "unknown": watch.since is None,
            }
            for watch in self._all
        ]

    def _ended_by(self, name: str, values: Mapping[str, Any] | None) -> list[_Watch]:
        enders = [(watch, watch.rule.recover_by) for watch in self._all]
        return [
            w for w, by in enders if by is not None and values is not None and is_given(self._model, by, name, values)
        ]

    def strikes(self, now: float) -> list[tuple[float, Deadline]]:
        """Return the deadlines that have struck up to now, and when: each once."""
        for watch in self._all:
            if watch.has_struck(now):
                self._strike(watch, watch.since)
        found, self._strikes = self._strikes, []
        return found

    def _strike(self, watch: _Watch, since: float | None) -> None:
        if since is not None and watch.told != since:
            watch.told = since
            self._strikes.append((since + watch.rule.after, watch.rule))

    def _act(self, watches: list[_Watch], times: NDArray[np.float64]) -> None:
        """Note when their message was sent: silence begins again with the last one that is not held back."""
        if any(watch.rule.start == Start.HELD and watch.since is None for watch in watches):
            return  # held from the MCU's start on, unless somebody recovered before
        if not len(times) or any(watch.holds_back(times[0]) for watch in watches):
            return
        shortest = min((w.rule.after for w in watches if w.rule.recover == Recover.EXPLICIT), default=np.inf)
        silences = np.flatnonzero(np.diff(times) >= shortest)
        last = int(silences[0]) if len(silences) else len(times) - 1
        for watch in watches:
            acted = times[: last + 1]
            if watch.since is not None:
                acted = np.concatenate(([watch.since], acted))
            for place in np.flatnonzero(np.diff(acted) >= watch.rule.after).tolist():
                self._strike(watch, float(acted[place]))
            watch.since = float(times[last])

    def _recover(self, ended: _Watch, watches: list[_Watch], t: float) -> None:
        """Recover as the MCU's end does: no effect if it has not struck, and each explicit one is ended by itself."""
        if ended.since is not None and not ended.has_struck(t):
            return
        for watch in watches:
            if watch.has_struck(t):
                self._strike(watch, watch.since)
            if watch is ended or not watch.holds_back(t):
                watch.since = t
