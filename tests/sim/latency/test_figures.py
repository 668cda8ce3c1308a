"""Percentiles and histograms of times, and the picture's preconditions."""

from __future__ import annotations

import io
import random
import sys
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from wirebond import UsageError
from wirebond.sim.latency import Measurement, figures, histogram
from wirebond.sim.latency.plot import draw, drawing_for


def test_a_percentile_is_a_time_that_was_measured() -> None:
    times = [float(n) for n in range(1, 1001)]
    random.Random(1).shuffle(times)
    made = figures(times)
    assert made is not None
    assert (made.p50, made.p90, made.p99, made.p99_9, made.most) == (500.0, 900.0, 990.0, 999.0, 1000.0)
    assert (made.count, made.least, made.mean) == (1000, 1.0, 500.5)
    one = figures([0.25])
    assert one is not None
    assert one.p50 == one.p99_9 == one.most == 0.25
    assert figures([]) is None


@pytest.mark.parametrize("times", [[0.001, 0.002, 0.5, 0.5], [0.0101, 0.0102], [-0.001, 0.0, 0.003], [0.25, 0.25]])
def test_every_time_is_in_one_bin_whose_bounds_hold_it(times: list[float]) -> None:
    bins = histogram(times)
    assert sum(count for _, _, count in bins) == len(times)
    assert (bins[0][0], bins[-1][1]) == (min(times), max(times))
    for (_, high, _), (low, _, _) in pairwise(bins):
        assert high == low
    for low, high, count in bins:
        assert count == sum(low <= t < high or t == high == max(times) for t in times)


def test_without_matplotlib_a_sentence_says_so_before_anything_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(UsageError, match=r"--plot needs matplotlib, which is not installed here; install it with"):
        drawing_for(Path("out.png"))
    with pytest.raises(UsageError, match=r"out does not end as a picture does; write out\.png"):
        drawing_for(Path("out"))


def test_the_picture_has_a_line_for_each_series_that_was_measured() -> None:
    drawn: list[tuple[list[float], str]] = []

    class Axes:
        def step(self, x: list[float], y: list[float], **options: Any) -> None:
            assert len(x) == len(y) and x == sorted(x) and y[0] == 1.0 and y[-1] > 0
            drawn.append((x, options["label"]))

        def __getattr__(self, name: str) -> Any:
            return lambda **_: None

    class Figure:
        def __init__(self, **_: Any) -> None: ...

        def add_subplot(self) -> Axes:
            return Axes()

        def savefig(self, file: io.BytesIO, format: str) -> None:
            file.write(format.encode())

    measured = Measurement(round_trips=[0.003, 0.001], to_mcu=[0.0005])
    assert draw(SimpleNamespace(Figure=Figure), "title", measured, "png") == b"png"
    assert drawn == [([1.0, 3.0], "round trip (2)"), ([0.5], "to the MCU (1)")]
