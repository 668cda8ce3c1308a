"""Finds the check of an unknown format: every algorithm of the catalogue, at every usual place."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from wirebond.analysis.checksum import checksum
from wirebond.analysis.explain.together import Together, chance_of
from wirebond.protocol.algorithms import ALGORITHMS, in_order
from wirebond.protocol.model import Algorithm, ByteOrder

_FIRST = 8  # frames that say whether a guess is worth more
_MOST_FRAMES = 64
_LEAST_SHARE = 0.12  # of the frames must have it
_DEEPEST = {4: 28, 3: 12, 2: 12, 1: 12}  # bytes at the front of a frame that a check of this size may leave out
_MOST_BYTES = 6_000_000  # that are looked at
_FIXED_COST_BYTES = 100  # of one computation, beside its bytes
_CHANCE = 1e-6  # that a guess fits this many frames by accident
_MOST_HEADERS = 0.7  # of the headers must have a check of their own
_LEAST_UNLIKE = 4  # contents that a check in the header must cover, and values that any check must have


@dataclass(frozen=True)
class Place:
    """The place of a check and the bytes that it covers. ``at``: from the frame's end if negative, else from its start.
    It covers the bytes from ``first`` up to itself. One that ``looks_ahead`` covers all bytes from ``first`` after
    itself.

    ``hexadecimal``: each byte is two digits.
    """

    at: int
    size: int
    first: int
    hexadecimal: bool = False
    gap: int = 0  # bytes before a check that it does not cover
    looks_ahead: bool = False

    def of(self, frame: bytes) -> tuple[bytes, bytes] | None:
        """Return the check's bytes and the covered bytes, or None if the frame is too short."""
        width = self.size * (2 if self.hexadecimal else 1)
        begin = self.at + len(frame) if self.at < 0 else self.at
        if begin < 0 or begin + width > len(frame):
            return None
        covered = frame[begin + width + self.first :] if self.looks_ahead else frame[self.first : begin - self.gap]
        found = frame[begin : begin + width]
        if self.hexadecimal:
            try:
                found = bytes.fromhex(found.decode("ascii"))
            except ValueError:
                return None
        return (found, covered) if covered else None


@dataclass(frozen=True)
class Check:
    """A check that ``fits`` of ``of`` frames have."""

    algorithm: Algorithm
    order: ByteOrder
    place: Place
    fits: int
    of: int

    def holds(self, frame: bytes) -> bool:
        """Return whether the check of this frame is right."""
        return _holds(self.algorithm, self.order, self.place, frame)


def best_check(
    frames: Sequence[bytes], start: int, tail: int, *, in_front: bool, whole: Sequence[range] = ()
) -> Check | None:
    """Return the widest check that most frames have; of equal ones the one that fits most, and covers most.

    :param start: bytes that every frame begins with.
    :param tail: bytes that every frame ends with. The check is before them.
    :param in_front: search also after the start, and not only at the end.
    :param whole: places within numbers, where nothing that is covered can begin.
    """
    unlike = _unlike(frames)
    places = _places(unlike, start, tail, in_front=in_front)
    return _best(unlike, (place for place in places if not any(place.first in inner for inner in whole)))


def header_check(frames: Sequence[bytes], start: int, before: int) -> Check | None:
    """Return a check over the first bytes of a frame alone, which is in front of byte ``before``.

    Headers are often alike: each is counted once.
    """
    found: Check | None = None
    for size in (2, 1):
        for at in range(start + 1, before - size + 1):
            heads = _often(frames, at + size)
            if len({head[:at] for head in heads}) >= _LEAST_UNLIKE:
                places = (Place(at, size, first) for first in dict.fromkeys((0, start)))
                found = _best(heads, places, least=_MOST_HEADERS) or found
    return found


def _often(frames: Sequence[bytes], size: int) -> list[bytes]:
    """Return the first bytes of frames; those of damaged ones come once."""
    counts = Counter(frame[:size] for frame in frames if len(frame) > size)
    again = [head for head, count in counts.items() if count > 1]
    return again if len(again) >= _LEAST_UNLIKE else list(counts)


def _best(frames: Sequence[bytes], places: Iterator[Place], least: float = _LEAST_SHARE) -> Check | None:
    if len(frames) < _LEAST_UNLIKE:
        return None
    first = frames[:: max(1, len(frames) // _FIRST)][:_FIRST]  # the shortest may be torn
    spent = tried = 0
    best: Check | None = None
    for place in places:
        if best is not None and place.size < best.place.size:
            break
        for algorithm in _of_size(place.size):
            for order in ByteOrder if place.size > 1 else (ByteOrder.LITTLE,):
                one = in_order(algorithm, order)
                tried += 1
                spent += sum(map(len, first)) + len(first) * _FIXED_COST_BYTES
                if spent > _MOST_BYTES:
                    return best
                if not any(_holds(one, order, place, frame) for frame in first):
                    continue
                holding = [frame for frame in frames if _holds(one, order, place, frame)]
                fits = len(holding)
                if fits < least * len(frames) or (best is not None and fits <= best.fits):
                    continue
                if len({found[0] for frame in holding if (found := place.of(frame))}) < _LEAST_UNLIKE:
                    continue  # such as the sum of zeros: it proves nothing
                if chance_of(2**algorithm.width, tried, Together(fits, len(frames))) < _CHANCE:
                    best = Check(one, order, place, fits, len(frames))
    return best


def _unlike(frames: Sequence[bytes]) -> list[bytes]:
    """Return the shortest frames of those that differ: of short ones fewer are damaged, and what repeats proves
    nothing."""
    return sorted(dict.fromkeys(frames), key=len)[:_MOST_FRAMES]


def _places(frames: Sequence[bytes], start: int, tail: int, *, in_front: bool) -> Iterator[Place]:
    """Yield the places, the widest first, and of each width those that cover most."""
    least = min(map(len, frames))
    digits = sum(_ends_with_digits(frame, tail) for frame in frames) > 0.8 * len(frames)
    for size in (4, 3, 2, 1):
        for first in (0, *range(max(start, 1), min(_DEEPEST[size], least) + 1)):
            yield Place(-size - tail, size, first)
            if digits:
                yield Place(-2 * size - tail, size, first, hexadecimal=True)
                yield Place(-2 * size - tail, size, first, hexadecimal=True, gap=1)
        for first in range(3 if in_front else 0):
            yield Place(start, size, first, looks_ahead=True)


def _ends_with_digits(frame: bytes, tail: int) -> bool:
    end = len(frame) - tail
    return end >= 2 and all(byte in b"0123456789ABCDEFabcdef" for byte in frame[end - 2 : end])


def _of_size(size: int) -> list[Algorithm]:
    return [one for one in ALGORITHMS.values() if (one.width + 7) // 8 == size]


def _holds(algorithm: Algorithm, order: ByteOrder, place: Place, frame: bytes) -> bool:
    found = place.of(frame)
    if found is None:
        return False
    value = checksum(algorithm, found[1])
    return value >= 0 and int.from_bytes(found[0], "big" if order == ByteOrder.BIG else "little") == value
