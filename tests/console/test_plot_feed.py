"""Batches of a plot, without a server: what comes late to a burst takes back the gap that was drawn before it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.console.conftest import read_batch
from tests.shared import codec
from wirebond.console.plots import PlotFeed
from wirebond.console.wants import Plot
from wirebond.protocol.model import End
from wirebond.recording.history.source import Source

pytestmark = pytest.mark.live


class Client:
    """The data that a client holds, as docs/console-api.md says."""

    def __init__(self, source: Source) -> None:
        self._feed = PlotFeed(Plot("p", ("odometry.left_ticks",), seconds=100.0, pixels=10_000))
        self._source = source
        self.rows: list[tuple[float, float]] = []

    def look(self, now: float) -> bool:
        """Was there anything new?"""
        data = self._feed.batch(self._source.history, now)
        if data is None:
            return False
        batch = read_batch(data)
        for t, low, _ in batch.columns.values():
            self.rows = [] if batch.head["replace"] else [row for row in self.rows if row[0] < t[0]]
            self.rows += zip(t.tolist(), low.tolist(), strict=True)
        return True

    @property
    def gaps(self) -> int:
        return int(np.isnan([low for _, low in self.rows]).sum())

    @property
    def values(self) -> list[float]:
        return [low for _, low in self.rows if not np.isnan(low)]


def feed(source: Source, first: int, times: list[float]) -> None:
    frames = [source.codec.encode("odometry", left_ticks=first + n, right_ticks=0) for n in range(len(times))]
    source.feed(End.MCU, frames, times)


def test_a_gap_is_taken_back_when_what_was_missing_comes_all_at_once() -> None:
    source = Source(codec("diffdrive"), End.HOST, 0.01)
    client = Client(source)
    feed(source, 0, [1.0, 1.05, 1.1])
    assert client.look(1.1)
    feed(source, 3, [3.1])  # the first of what waited for two seconds
    assert client.look(3.1)
    assert client.gaps == 1
    assert not client.look(3.11)
    feed(source, 4, [3.12 + n * 0.001 for n in range(39)])
    assert client.look(3.2)
    assert client.gaps == 0
    feed(source, 43, [3.2 + n * 0.05 for n in range(8)])
    assert client.look(3.6)
    assert client.values[:3] == [0, 1, 2] and client.values[-1] == 50


def test_a_gap_that_stays_is_reported_once() -> None:
    source = Source(codec("diffdrive"), End.HOST, 0.01)
    client = Client(source)
    feed(source, 0, [1.0, 1.05])
    client.look(1.1)
    for number in range(8):
        feed(source, 2 + number, [3.0 + number * 0.05])
        assert client.look(3.0 + number * 0.05)
        assert client.gaps == 1
    assert client.values == list(range(10))
    assert not client.look(3.5)
