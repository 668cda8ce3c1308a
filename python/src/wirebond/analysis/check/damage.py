"""Bit errors put into frames, and how many of the damaged frames the decoder still delivers.

Bits are numbered as a UART sends them: byte by byte, the lowest bit first. Each damaged frame has an intact one before
and after it, so that the frame's own check is measured and not its neighbours' damage.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wirebond.analysis.samples import Pool

Integers = NDArray[np.int64]
Flips = tuple[Integers, Integers]  # row of the damaged frame, bit within it; no pair twice
Fault = Callable[[Integers, np.random.Generator], Flips]  # from the frames' sizes in bits

_MOST_BYTES = 24_000_000  # of one decoded stream
_MOST_BLOCKS = 5000  # of one measurement where silence ends a frame: each is decoded by itself
_MOST_ERRORS = 8  # bit errors in one frame; more have no weight at the rates used here


@dataclass(frozen=True)
class Measured:
    """``accepted`` of ``samples`` damaged frames were delivered as a frame."""

    samples: int
    accepted: int

    @property
    def share(self) -> float:
        return self.accepted / self.samples if self.samples else 0.0

    @property
    def at_most(self) -> float:
        """If none was accepted: the share that 95 % of such measurements stay below (rule of three)."""
        return min(1.0, 3 / self.samples) if self.samples and not self.accepted else self.share

    def __add__(self, other: Measured) -> Measured:
        return Measured(self.samples + other.samples, self.accepted + other.accepted)


def wrong_bits(number: int) -> Fault:
    """Make a fault of exactly this many wrong bits, anywhere in the frame."""

    def fault(bits: Integers, generator: np.random.Generator) -> Flips:
        places = generator.integers(0, bits[:, None], (len(bits), number))
        while True:
            ordered = np.sort(places, axis=1)
            repeated = np.flatnonzero((ordered[:, 1:] == ordered[:, :-1]).any(axis=1))
            if not len(repeated):
                return np.repeat(np.arange(len(bits)), number), places.ravel()
            places[repeated] = generator.integers(0, bits[repeated, None], (len(repeated), number))

    return fault


def burst(longest: int) -> Fault:
    """Return a run of 2 to ``longest`` bits whose first and last are wrong, and every other one by chance."""

    def fault(bits: Integers, generator: np.random.Generator) -> Flips:
        length = generator.integers(2, np.minimum(longest, bits) + 1)
        first = generator.integers(0, bits - length + 1)
        steps = np.arange(longest)
        wrong = generator.random((len(bits), longest)) < 0.5
        wrong[:, 0] = True
        wrong[np.arange(len(bits)), length - 1] = True
        wrong &= steps[None, :] < length[:, None]
        rows, offsets = np.nonzero(wrong)
        return rows, first[rows] + offsets

    return fault


def bit_error_rate(rate: float) -> Fault:
    """Make a fault that inverts every bit with this chance, in frames that get at least one error."""

    def fault(bits: Integers, generator: np.random.Generator) -> Flips:
        odds = _chance_of_errors(bits, rate)
        errors = 1 + (generator.random(len(bits))[:, None] > np.cumsum(odds, axis=1)[:, :-1]).sum(axis=1)
        rows = np.repeat(np.arange(len(bits)), errors)
        pairs = np.unique(np.stack((rows, generator.integers(0, bits[rows]))), axis=1)
        return pairs[0], pairs[1]

    return fault


def measure(pool: Pool, fault: Fault, samples: int, seed: int, weights: NDArray[np.float64] | None = None) -> Measured:
    """Damage ``samples`` frames of the pool and count those that are delivered. ``weights``: each frame's chance."""
    generator = np.random.default_rng(seed)
    sizes = np.array([len(frame) for frame in pool.frames])
    by_silence = pool.codec.model.format.ends_by_silence
    samples = max(1, min(samples, _MOST_BLOCKS if by_silence else int(_MOST_BYTES // (2 * sizes.mean()))))
    chosen = generator.choice(len(sizes), samples, p=weights)
    guards = generator.integers(0, len(sizes), samples)
    order = np.stack((chosen, guards), axis=1).ravel()
    starts = np.concatenate(([0], np.cumsum(sizes[order])))
    first = pool.frames[0]  # so that the first damaged frame has a neighbour, too
    lead = len(first)
    data = np.frombuffer(first + b"".join(map(pool.frames.__getitem__, order.tolist())), dtype=np.uint8).copy()
    rows, places = fault(8 * sizes[chosen], generator)
    at = lead + starts[2 * rows] + places // 8
    np.bitwise_xor.at(data, at, np.left_shift(1, places % 8).astype(np.uint8))
    if by_silence:
        blocks = [data[lead + a : lead + b].tobytes() for a, b in zip(starts[:-1:2], starts[1::2], strict=True)]
        return Measured(samples, sum(1 for found in decode_blocks(pool, blocks) if found))
    tables = pool.codec.decode_columns(data.tobytes(), pool.sender)
    offsets = [table.offset for table in tables.values()]
    delivered = np.concatenate(offsets).astype(np.int64) if offsets else np.empty(0, dtype=np.int64)
    slots = np.searchsorted(starts, delivered[delivered >= lead] - lead, side="right") - 1
    return Measured(samples, len(np.unique(slots[slots % 2 == 0])))


def decode_blocks(pool: Pool, blocks: Iterable[bytes]) -> Iterator[int]:
    """Yield how many frames each block contains if silence ends a frame: the line is quiet before and after each
    block."""
    decoder = pool.codec.decoder(pool.sender)
    pause = 2 * pool.codec.model.idle_seconds
    now = 0.0
    for block in blocks:
        found = len(decoder.feed(block, now))
        now += pause
        yield found + len(decoder.idle(now))
        now += pause


def weights_by_damage(pool: Pool, rate: float) -> NDArray[np.float64]:
    """Return how likely each frame of the pool is damaged at this bit error rate: long frames are hit more often."""
    bits = 8 * np.array([len(frame) for frame in pool.frames])
    hit = -np.expm1(bits * np.log1p(-rate))
    return np.asarray(hit / hit.sum(), dtype=np.float64)


def _chance_of_errors(bits: Integers, rate: float) -> NDArray[np.float64]:
    """Return the chances of 1, 2, … errors in a frame that has at least one, a row for each frame."""
    chances = []
    chance = (1 - rate) ** bits.astype(np.float64)
    for number in range(1, _MOST_ERRORS + 1):
        chance = chance * (bits - number + 1) / number * rate / (1 - rate)
        chances.append(chance)
    table = np.stack(chances, axis=1)
    return np.asarray(table / table.sum(axis=1, keepdims=True), dtype=np.float64)
