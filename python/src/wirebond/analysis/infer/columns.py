"""Classifies the bytes at one place of many frames: constant, a counter, one of a few values."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

_NEARLY_ALL = 0.95  # damaged frames are among them
_COUNTS = 0.8
_MOST_IDS = 64
_SEEN = 3  # times that a value comes on average, at least, if it is one of a few


@dataclass(frozen=True)
class Column:
    """The bytes at ``at``, of the frames that are as long."""

    at: int
    values: tuple[int, ...]

    @property
    def constant(self) -> int | None:
        """The value that nearly all have."""
        value, count = Counter(self.values).most_common(1)[0]
        return value if count >= _NEARLY_ALL * len(self.values) else None

    @property
    def steps(self) -> int | None:
        """By how much it counts up from frame to frame, modulo 256; None: it does not."""
        pairs = zip(self.values, self.values[1:], strict=False)
        steps = Counter(after - before & 0xFF for before, after in pairs)
        step, count = steps.most_common(1)[0] if steps else (0, 0)
        return step if 0 < step <= 16 and count >= _COUNTS * (len(self.values) - 1) else None

    @property
    def few(self) -> tuple[int, ...]:
        """Its values, where they are so few that each comes again; those of damaged frames left out. Else empty."""
        counts = Counter(self.values)
        again = [value for value, count in counts.items() if count > 1]
        often = sum(counts[value] for value in again)
        is_few = len(again) <= min(_MOST_IDS, len(self.values) // _SEEN) and often >= 0.9 * len(self.values)
        return tuple(sorted(again)) if is_few else ()


def column(frames: Sequence[bytes], at: int) -> Column | None:
    """Describe the bytes at one place of all frames; None if hardly a frame is that long."""
    values = tuple(frame[at] for frame in frames if len(frame) > at)
    return Column(at, values) if len(values) > 0.5 * len(frames) and len(values) > 1 else None


def tells_size(frames: Sequence[bytes], at: int) -> float:
    """Return the part of the frames whose size the byte at ``at`` gives, if each value goes with one size."""
    sizes: defaultdict[int, Counter[int]] = defaultdict(Counter)
    for frame in frames:
        if len(frame) > at:
            sizes[frame[at]][len(frame)] += 1
    return sum(counts.most_common(1)[0][1] for counts in sizes.values()) / len(frames)
