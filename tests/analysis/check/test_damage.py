"""The faults are those that their names promise."""

from __future__ import annotations

import numpy as np
import pytest
from tests.analysis.check.files import made, shipped

from wirebond.analysis.check.damage import (
    Measured,
    bit_error_rate,
    burst,
    measure,
    weights_by_damage,
    wrong_bits,
)
from wirebond.analysis.samples import pool
from wirebond.protocol.model import End

BITS = np.repeat(np.array([16, 88, 360]), 20_000)


@pytest.mark.parametrize("number", [1, 2, 3])
def test_wrong_bits_are_that_many_different_bits_of_the_frame(number: int) -> None:
    rows, places = wrong_bits(number)(BITS, np.random.default_rng(1))
    pairs = set(zip(rows.tolist(), places.tolist(), strict=True))
    assert len(pairs) == len(rows) == number * len(BITS)
    assert (places < BITS[rows]).all()
    assert (places >= 0).all()
    assert set(places[BITS[rows] == 16].tolist()) == set(range(16))


@pytest.mark.parametrize("longest", [8, 16, 32])
def test_a_burst_begins_and_ends_with_a_wrong_bit_and_is_no_longer(longest: int) -> None:
    rows, places = burst(longest)(BITS, np.random.default_rng(1))
    first = np.full(len(BITS), 10**6)
    last = np.full(len(BITS), -1)
    np.minimum.at(first, rows, places)
    np.maximum.at(last, rows, places)
    lengths = last - first + 1
    assert (lengths >= 2).all()
    assert (lengths <= np.minimum(longest, BITS)).all()
    assert lengths.max() == longest
    assert (last < BITS).all()


def test_bit_errors_come_at_the_rate_in_frames_that_have_any() -> None:
    rate = 1e-3
    rows, _ = bit_error_rate(rate)(BITS, np.random.default_rng(1))
    assert set(rows.tolist()) == set(range(len(BITS)))
    for bits in (16, 88, 360):
        mean = np.bincount(rows, minlength=len(BITS))[bits == BITS].mean()
        assert mean == pytest.approx(bits * rate / (1 - (1 - rate) ** bits), rel=0.01)


def test_long_frames_are_damaged_more_often() -> None:
    own = pool(shipped("pid_tuner"), End.HOST, 1, frames_a_message=1)
    assert own is not None
    weights = weights_by_damage(own, 1e-4)
    sizes = np.array([len(frame) for frame in own.frames])
    assert weights.sum() == pytest.approx(1)
    assert weights[0] / weights[1] == pytest.approx(sizes[0] / sizes[1], rel=0.01)


def test_an_undamaged_frame_is_accepted_and_a_frame_without_its_magic_is_not() -> None:
    codec = made("[magic: 0xA5, id: u8, payload: by_id]")
    own = pool(codec, End.MCU, 1)
    assert own is not None

    def nothing(bits, generator):  # type: ignore[no-untyped-def]
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)

    def no_magic(bits, generator):  # type: ignore[no-untyped-def]
        return np.arange(len(bits)), np.zeros(len(bits), dtype=np.int64)

    assert measure(own, nothing, 500, 1) == Measured(500, 500)
    assert measure(own, no_magic, 500, 1).share < 0.02


def test_nothing_seen_is_reported_with_its_bound() -> None:
    assert Measured(3000, 0).at_most == pytest.approx(0.001)
    assert Measured(3000, 30).at_most == Measured(3000, 30).share == 0.01
