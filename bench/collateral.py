"""Collateral: frames that no fault touched and that are yet not delivered. Definitions as in the baseline.

1e6 frames of the enterprize format with payloads of 9, 12, 6, 26, 13 and 40 bytes, random contents, fed to the engine
in 64-byte chunks. Bit errors at the given rate; drops and inserts 1e-3 a byte; garbage is 1 to 32 random bytes in 10 %
of the gaps; sync-heavy garbage is half start bytes. The frames are built here with numpy, independent of the encoder.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import wirebond
from bench.figures import ROOT, Figure

Bytes = NDArray[np.uint8]
Places = NDArray[np.int64]

FRAMES = 1_000_000
CHUNK = 64
SEED = 20260101
MIX = (
    (0xB2, 9),
    (0xB3, 12),
    (0xB4, 6),
    (0xB7, 26),
    (0xB8, 13),
    (0xA5, 40),
)  # id, payload; A5 is an unknown id
START = 0xAA
PROTOCOL = ROOT / "protocols" / "enterprize.yaml"


@dataclass(frozen=True)
class Traffic:
    """A stream, and where in it each frame that is still intact begins."""

    data: Bytes
    starts: Places
    sizes: Places


@dataclass(frozen=True)
class Outcome:
    intact: int
    collateral: int
    false_frames: int  # delivered, and equal to nothing that was sent


def clean_traffic(frames: int, random: np.random.Generator) -> Traffic:
    kinds = random.integers(0, len(MIX), frames)
    sizes = np.array([payload + 7 for _, payload in MIX], dtype=np.int64)[kinds]
    starts = np.concatenate(([0], np.cumsum(sizes)[:-1]))
    data = np.empty(int(sizes.sum()), dtype=np.uint8)
    for kind, (message_id, payload) in enumerate(MIX):
        rows = np.flatnonzero(kinds == kind)
        block = random.integers(0, 256, (len(rows), payload + 7), dtype=np.uint8)
        block[:, 0], block[:, 1], block[:, 2] = START, payload, message_id
        _put_crc(block, 3)
        _put_crc(block, payload + 5)
        data[starts[rows][:, None] + np.arange(payload + 7)] = block
    return Traffic(data, starts, sizes)


def _put_crc(block: Bytes, at: int) -> None:
    """CRC-16/MCRF4XX of the first ``at`` columns of every row, bit by bit, little-endian at ``at``."""
    register = np.full(len(block), 0xFFFF, dtype=np.uint16)
    for column in range(at):
        register ^= block[:, column]
        for _ in range(8):
            register = (register >> 1) ^ np.where(register & 1, 0x8408, 0).astype(np.uint16)
    block[:, at], block[:, at + 1] = register & 0xFF, register >> 8


# ---- faults: each returns the damaged stream with the frames that it did not touch


def bit_errors(rate: float) -> Callable[[Traffic, np.random.Generator], Traffic]:
    def apply(traffic: Traffic, random: np.random.Generator) -> Traffic:
        flips = np.unique(random.integers(0, 8 * len(traffic.data), round(rate * 8 * len(traffic.data))))
        data = traffic.data.copy()
        np.bitwise_xor.at(data, flips // 8, np.left_shift(1, flips % 8).astype(np.uint8))
        return _without(Traffic(data, traffic.starts, traffic.sizes), touched_bytes=data != traffic.data)

    return apply


def drops(traffic: Traffic, random: np.random.Generator) -> Traffic:
    dropped = random.random(len(traffic.data)) < 1e-3
    moved = traffic.starts - np.cumsum(dropped)[traffic.starts] + dropped[traffic.starts]
    return _without(Traffic(traffic.data[~dropped], moved, traffic.sizes), touched_bytes=dropped, before=traffic)


def inserts(traffic: Traffic, random: np.random.Generator) -> Traffic:
    before = np.flatnonzero(random.random(len(traffic.data)) < 1e-3)
    data = np.insert(traffic.data, before, random.integers(0, 256, len(before), dtype=np.uint8))
    inside = np.zeros(len(traffic.data), dtype=bool)
    inside[before] = True
    moved = traffic.starts + np.searchsorted(before, traffic.starts, side="right")
    inside[traffic.starts] = False  # before its first byte is between frames: that touches none
    return _without(Traffic(data, moved, traffic.sizes), touched_bytes=inside, before=traffic)


def garbage(start_share: float) -> Callable[[Traffic, np.random.Generator], Traffic]:
    def apply(traffic: Traffic, random: np.random.Generator) -> Traffic:
        gaps = np.flatnonzero(random.random(len(traffic.starts)) < 0.1)
        lengths = random.integers(1, 33, len(gaps))
        junk = random.integers(0, 256, int(lengths.sum()), dtype=np.uint8)
        junk[random.random(len(junk)) < start_share] = START
        data = np.insert(traffic.data, np.repeat(traffic.starts[gaps], lengths), junk)
        added = np.zeros(len(traffic.starts), dtype=np.int64)
        added[gaps] = lengths
        return Traffic(data, traffic.starts + np.cumsum(added), traffic.sizes)

    return apply


def _without(damaged: Traffic, touched_bytes: NDArray[np.bool_], before: Traffic | None = None) -> Traffic:
    """Keep the frames none of whose bytes (at their places ``before`` the fault) is marked."""
    original = before or damaged
    marks = np.concatenate(([0], np.cumsum(touched_bytes)))
    whole = marks[original.starts + original.sizes] == marks[original.starts]
    return Traffic(damaged.data, damaged.starts[whole], damaged.sizes[whole])


FAULTS: dict[str, tuple[Callable[[Traffic, np.random.Generator], Traffic], int]] = {
    # key: fault, reference row of the baseline
    "ber_1e4": (bit_errors(1e-4), 0),
    "ber_1e3": (bit_errors(1e-3), 0),
    "drop": (drops, 7),
    "insert": (inserts, 0),
    "garbage": (garbage(0.0), 0),
    "sync_garbage": (garbage(0.5), 0),
}


@functools.cache
def _codec() -> wirebond.Codec:
    return wirebond.load(PROTOCOL)


def run(sent: Traffic, received: Traffic, chunk: int) -> Outcome:
    decoder = _codec().decoder()
    stream = received.data.tobytes()
    messages = [m for at in range(0, len(stream), chunk) for m in decoder.feed(stream[at : at + chunk])]
    messages += decoder.finish()
    stats = decoder.stats
    assert stats.bytes == stats.frame_bytes + stats.fill_bytes + sum(stats.discarded_bytes.values())

    offsets = np.array([m.offset for m in messages], dtype=np.int64)
    delivered = np.isin(received.starts, offsets)
    strange = np.flatnonzero(~np.isin(offsets, received.starts))
    false_frames = 0
    if len(strange):
        originals = sent.data.tobytes()
        known = {originals[s : s + n] for s, n in zip(sent.starts.tolist(), sent.sizes.tolist(), strict=True)}
        false_frames = sum(messages[i].raw not in known for i in strange)
    return Outcome(len(received.starts), int((~delivered).sum()), false_frames)


def measure(frames: int = FRAMES) -> list[Figure]:
    command = "make bench ONLY=collateral"
    figures = []
    for key, (fault, reference) in FAULTS.items():
        random = np.random.default_rng(SEED)
        sent = clean_traffic(frames, random)
        outcome = run(sent, fault(sent, random), CHUNK)
        found = f"{outcome.collateral} lost, {outcome.false_frames} delivered but never sent"
        print(f"{key}: {outcome.intact} intact, {found}")
        figures.append(Figure(f"collateral_{key}", outcome.collateral, "frames", reference, command))
    return figures


def measure_clean(frames: int = 2000, chunks: range = range(1, 4097)) -> list[Figure]:
    traffic = clean_traffic(frames, np.random.default_rng(SEED))
    lost = sum(run(traffic, traffic, chunk).collateral for chunk in chunks)
    return [Figure("clean_loss", lost, "frames", 0, "make bench ONLY=clean_loss")]
