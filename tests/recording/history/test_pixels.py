"""Least and greatest per pixel against a slow reference, over chunks, blocks, gaps and memory that is full."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.cost import calls
from wirebond.recording.history import pixels, track
from wirebond.recording.history.pixels import Pixels, pixels_of
from wirebond.recording.history.track import Track

SMALL = {"ROWS": 64, "BLOCK": 8, "_FIRST_ROWS": 4}  # as whole chunks and blocks, and quick


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in SMALL.items():
        monkeypatch.setattr(track, name, value)


def slow(
    t: Any, values: Any, begin: float, end: float, width: float, interval: float | None, breaks: list[float]
) -> list[tuple[float, float, float]]:
    """Sample by sample."""
    out: list[tuple[float, float, float]] = []
    pixel, last = None, math.nan
    for at, value in zip(t.tolist(), values.tolist(), strict=True):
        if not begin <= at <= end:
            continue
        here = math.floor(at / width)
        if pixel is not None and here == pixel:
            low, high = out[-1][1:]
            out[-1] = out[-1][0], float(np.fmin(low, value)), float(np.fmax(high, value))
        else:
            until = at + pixels.BURST * (at - last)
            came = int(((t >= at) & (t <= until)).sum())
            is_gap = interval is not None and at - last > (pixels.GAP - 1 + came) * interval
            if pixel is not None and (is_gap or any(last <= away <= at for away in breaks)):
                out.append((math.nextafter(last, math.inf), math.nan, math.nan))
            out.append((at, value, value))
        pixel, last = here, at
    return out


def assert_same(found: Pixels, wanted: list[tuple[float, float, float]]) -> None:
    assert len(found.t) == len(wanted)
    rows = np.array(wanted).reshape(-1, 3)
    np.testing.assert_array_equal(found.t, rows[:, 0])
    np.testing.assert_array_equal(found.low, rows[:, 1].astype(found.low.dtype))
    np.testing.assert_array_equal(found.high, rows[:, 2].astype(found.high.dtype))


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_every_range_has_the_extremes_of_all_its_samples(data: st.DataObject) -> None:
    with pytest.MonkeyPatch.context() as patch:
        for name, value in SMALL.items():
            patch.setattr(track, name, value)
        random = np.random.default_rng(data.draw(st.integers(0, 2**32)))
        kind = data.draw(st.sampled_from([np.float64, np.float32, np.int16, np.uint8, np.int64]))
        interval = data.draw(st.sampled_from([None, 0.01, 0.2]))
        found = Track({"x": np.dtype(kind)}, interval)
        ts, xs = np.empty(0), np.empty(0, kind)
        now = 0.0
        for _ in range(data.draw(st.integers(1, 8))):
            count = data.draw(st.integers(1, 90))
            steps = random.exponential(data.draw(st.sampled_from([0.001, 0.02, 0.5])), count)
            steps[random.random(count) < 0.2] = 0.0  # several in one read
            t = now + np.cumsum(steps)
            x = (random.normal(0, 50, count)).astype(kind)
            if np.issubdtype(kind, np.floating):
                x[random.random(count) < 0.1] = np.nan
            found.append(t, {"x": x})
            ts, xs, now = np.concatenate([ts, t]), np.concatenate([xs, x]), float(t[-1])
        breaks = sorted(random.uniform(0, now, data.draw(st.integers(0, 3))).tolist())
        for _ in range(5):
            begin = float(random.uniform(-0.5, now))
            end = begin + float(random.exponential(now or 1.0)) + 1e-3
            width = (end - begin) / int(random.integers(1, 400))
            wanted = slow(ts, xs, begin, end, width, interval, breaks)
            assert_same(pixels_of(found, ["x"], begin, end, width, breaks)[0], wanted)
        assert found.count == len(ts)
        low, high = sorted(random.uniform(0, now, 2).tolist())
        assert found.count_between(low, high) == int(((ts >= low) & (ts < high)).sum())


def test_a_peak_of_one_sample_is_seen_at_every_zoom() -> None:
    found = Track({"x": np.dtype(np.float32)})
    t = np.arange(300_000) / 1000
    x = np.zeros(300_000, np.float32)
    x[123_456], x[200_001] = 9.0, -7.0
    found.append(t, {"x": x})
    for width in (0.001, 0.02, 1.0, 17.0, 300.0):
        got = pixels_of(found, ["x"], 0.0, 300.0, width)[0]
        assert (float(got.low.min()), float(got.high.max())) == (-7.0, 9.0)


def test_an_update_replaces_only_the_last_pixel(small: None) -> None:
    """As /views sends it: rows from the begin of the newest known pixel on join the older ones without a seam."""
    found = Track({"x": np.dtype(np.float64)}, 0.01)
    random = np.random.default_rng(3)
    held: list[tuple[float, float, float]] = []
    now, begin = 0.0, 0.0
    for _ in range(40):
        t = now + np.cumsum(random.exponential(0.01, 30))
        found.append(t, {"x": random.normal(size=30)})
        now = float(t[-1])
        new = pixels_of(found, ["x"], begin, now, 0.05)[0]
        held = [row for row in held if row[0] < new.t[0]]
        held += zip(new.t.tolist(), new.low.tolist(), new.high.tolist(), strict=True)
        begin = math.floor(new.t[-1] / 0.05) * 0.05
    whole = pixels_of(found, ["x"], 0.0, now, 0.05)[0]
    seam = [row for row in held if not math.isnan(row[1])]
    is_data = ~np.isnan(whole.low)
    np.testing.assert_array_equal([row[0] for row in seam], whole.t[is_data])
    np.testing.assert_array_equal([row[1] for row in seam], whole.low[is_data])
    np.testing.assert_array_equal([row[2] for row in seam], whole.high[is_data])


@pytest.mark.parametrize("apart", [0.0, 4e-5], ids=["one read", "reads close together"])
def test_rows_that_waited_in_an_adapter_are_no_gap_and_missing_ones_are(apart: float) -> None:
    """1 kHz over an adapter that hands on what came every 16 ms."""
    found = Track({"x": np.dtype(np.float64)}, 0.001)
    made = np.arange(1, 16 * 63 + 1) * 0.001
    handed = np.ceil(made / 0.016 - 1e-9) * 0.016 + np.arange(len(made)) % 16 * apart
    is_lost = (made > 0.5005) & (made < 0.5255)
    found.append(handed[~is_lost], {"x": made[~is_lost]})
    for width in (0.0005, 0.005, 0.02):
        shown = pixels_of(found, ["x"], 0.0, 1.1, width)[0]
        gaps = shown.t[np.isnan(shown.low)]
        assert len(gaps) > 0
        assert all(0.495 < t < 0.53 for t in gaps), width


def test_an_hour_of_1_khz_in_8_fields_is_looked_at_without_reading_every_sample() -> None:
    """Counted, not timed: at most one row in 32 of whole chunks is looked at, however long the range."""
    looked = 0
    plain = track._Unfolding.least_and_greatest

    def counted(unfolding: Any, column: Any, low: Any, high: Any) -> Any:
        nonlocal looked
        looked += unfolding.size
        return plain(unfolding, column, low, high)

    found = Track({"x": np.dtype(np.int16)})
    t = np.arange(3_600_000) / 1000
    found.append(t, {"x": np.zeros(len(t), np.int16)})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(track._Unfolding, "least_and_greatest", counted)
        cost = calls(lambda: pixels_of(found, ["x"], 0.0, 3600.0, 3600 / 800))
    assert cost < 9_000
    assert 0 < looked < len(t) / 16
