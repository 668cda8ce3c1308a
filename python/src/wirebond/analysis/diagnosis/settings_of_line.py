"""Wrong baud rate or parity: which settings would make such bytes of this protocol's frames."""

from __future__ import annotations

import itertools
import math
import random
from collections import Counter
from collections.abc import Iterator

from wirebond.analysis.diagnosis.finding import Diagnosis, Kind
from wirebond.analysis.diagnosis.uart import misread
from wirebond.analysis.samples import pool
from wirebond.codec import Codec
from wirebond.protocol.model import End, Parity

_RATES = (
    2400, 4800, 9600, 19200, 38400, 57600, 100000, 115200, 230400, 250000, 420000, 460800, 500000, 921600, 1000000,
    1500000, 2000000,
)  # fmt: skip
_LEAST_BYTES = 100
_MOST_BYTES = 4000  # of the received ones that are compared
_SAMPLE_BYTES = 1500
_CLEAR = 0.35  # bits a byte by which the settings must explain the bytes better than any byte at random
_LEAST_ENTROPY = 1.0  # bits a byte: a line that is open or stuck gives one value again and again
_MOST_OFF = 0.8  # bits a byte that the bytes as they are would take less: else it is another line altogether
_APART = 0.1  # bits a byte between the best rate and the file's own
_FEW_VALUES = 12


def parity_of_seven_bits(data: bytes) -> Diagnosis | None:
    """Detect bytes of 7 bits and a parity bit, read as 8 bits: the number of ones is always even, or always odd."""
    if len(data) < _LEAST_BYTES or len(set(data)) < _FEW_VALUES:
        return None
    odd = sum(byte.bit_count() & 1 for byte in data)
    share = max(odd, len(data) - odd) / len(data)
    if share < 0.98:
        return None
    name = "odd" if odd > len(data) / 2 else "even"
    return Diagnosis(
        Kind.PARITY,
        f"The sender uses 7 data bits with {name} parity",
        f"{share:.0%} of {len(data)} bytes have an {name} number of ones",
        "Set the device to 8 data bits without parity, or correct `data_bits` and `parity` of `link` in the file.",
    )


def other_settings(codec: Codec, peer: End, data: bytes, baud: int) -> Diagnosis | None:
    """Return the rate or parity that explains the bytes best, if it does so clearly."""
    data = data[-_MOST_BYTES:]
    entropy = _entropy(data)
    if len(data) < _LEAST_BYTES or entropy < _LEAST_ENTROPY:
        return None
    own = codec.model.link.parity
    frames = _frames(codec, peer)
    if not frames:
        return None
    fits: dict[tuple[int, Parity], float] = {}
    for rate, parity in _candidates(baud, own):
        fits[rate, parity] = _fit(data, frames, (rate, parity), (baud, own))
    here = fits[baud, own]
    (rate, parity), best = max(fits.items(), key=lambda one: one[1])
    if best < _CLEAR or best - here < _APART or 8 - best - entropy > _MOST_OFF:
        return None
    near = sorted({r for (r, _), fit in fits.items() if r != baud and best - fit < _APART})
    evidence = (
        f"it explains {len(data)} bytes {best:.1f} bits a byte better than chance, the file's settings {here:.1f}"
    )
    if rate == baud:
        return Diagnosis(
            Kind.PARITY,
            f"The sender uses {'no parity' if parity == Parity.NONE else f'{parity} parity'}, and the link {own}",
            evidence,
            "Correct `parity` of `link` in the file, or the device's setting.",
        )
    rates = " or ".join(map(str, near[:3]))
    return Diagnosis(
        Kind.BAUD,
        f"The sender's baud rate is another one, probably {rates}, and the link runs at {baud}",
        evidence,
        f"Try `--baud {rate}`, or let `wirebond identify PORT` try every rate.",
    )


def _candidates(baud: int, own: Parity) -> Iterator[tuple[int, Parity]]:
    yield baud, own
    yield from ((baud, parity) for parity in Parity if parity != own)
    for rate in _RATES:
        if rate != baud and 1 / 16 < rate / baud < 16:
            yield rate, own


def _frames(codec: Codec, peer: End) -> list[bytes]:
    drawn = pool(codec, peer, 1, 24)
    if drawn is None:
        return []
    frames = list(drawn.frames)
    random.Random(1).shuffle(frames)  # noqa: S311  (to compare with, not to keep secrets)
    sizes = itertools.accumulate(len(frame) for frame in frames)
    return [frame for frame, size in zip(frames, sizes, strict=True) if size <= _SAMPLE_BYTES] or frames[:1]


def _entropy(data: bytes) -> float:
    """Return the entropy of these byte values, in bits per byte."""
    if not data:
        return 0.0
    return -sum(count / len(data) * math.log2(count / len(data)) for count in Counter(data).values())


def _fit(data: bytes, frames: list[bytes], sent: tuple[int, Parity], heard: tuple[int, Parity]) -> float:
    """Return by how many bits per byte the values of such a line explain these bytes better than 256 equal ones."""
    offsets = list(itertools.accumulate((len(frame) for frame in frames), initial=0))
    counts = Counter(misread(b"".join(frames), sent, heard, offsets))
    total = sum(counts.values())
    weight = 0.2 * total + 8  # of a byte at random: values of the fields are not known
    told = sum(math.log2((counts[byte] + weight / 256) / (total + weight)) for byte in data)
    return 8 + told / len(data)
