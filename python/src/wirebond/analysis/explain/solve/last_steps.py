"""The steps after the register: which negation, addend, mask and final xor make these values of those registers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

_MOST_DEAD = 300  # dead ends of the search through the bits


@dataclass(frozen=True)
class LastSteps:
    """``value = ((register ^ flips, negated or not) + plus & mask) ^ xorout``."""

    flips: int
    negate: bool
    plus: int
    mask: int
    xorout: int


@dataclass(frozen=True)
class _Kind:
    """The possible last steps. ``plus``: any addend. ``xors``: the possible bits of the final xor."""

    plus: bool
    xors: tuple[int, ...]
    mask: bool
    flips: bool


def last_steps(registers: Sequence[int], values: Sequence[int], width: int, *, flips: bool = False) -> LastSteps | None:
    """Return the simplest steps that make each register its value; None where none do.

    The bits are gone through from the lowest up: a bit of the addend decides the carry into the next, and the bit of
    the final xor follows from the first frame. The other frames refute wrong choices at once.

    :param flips: bits of the registers may be turned before, as by an unknown beginning.
    """
    if max(values) >> width:
        return None
    # -n is ~n + 1: then the same bits are inverted before and after the negation.
    numbers = {False: registers, True: [~register for register in registers]}
    all_steps = _Kind(plus=True, xors=(0, 1), mask=True, flips=flips)
    signs = [negate for negate in (False, True) if _Bits(numbers[negate], values, width, all_steps, None).may_be_found]
    for kind in _kinds(flips):
        for negate in signs:
            found = _Bits(numbers[negate], values, width, kind, None if kind.plus else int(negate)).search()
            if found is not None:
                flipped, addend, mask, xorout = found
                return LastSteps(flipped, negate, addend - negate & (1 << width) - 1, mask, xorout)
    return None


def _kinds(flips: bool) -> Iterator[_Kind]:
    """Yield the kinds of last steps, the simplest first."""
    for mask in (False, True):
        for flipped in (False, True) if flips else (False,):
            for plus, xors in product((False, True), ((0,), (1,), (0, 1))):
                yield _Kind(plus, xors, mask, flipped)


class _Bits:
    def __init__(
        self, numbers: Sequence[int], values: Sequence[int], width: int, kind: _Kind, addend: int | None
    ) -> None:
        self._numbers = numbers
        self._values = values
        self._width = width
        self._kind = kind
        self._addend = addend
        self._dead: set[tuple[int, tuple[int, ...]]] = set()

    @property
    def may_be_found(self) -> bool:
        return self.search() is not None or len(self._dead) > _MOST_DEAD

    def search(self) -> tuple[int, int, int, int] | None:
        return self._from(0, (0,) * len(self._values))

    def _from(self, bit: int, carries: tuple[int, ...]) -> tuple[int, int, int, int] | None:
        """Find flips, addend, mask and xor from ``bit`` on."""
        if bit == self._width:
            return 0, 0, 0, 0
        if (bit, carries) in self._dead or len(self._dead) > _MOST_DEAD:
            return None
        wanted = [value >> bit & 1 for value in self._values]
        for flip in (0, 1) if self._kind.flips else (0,):
            for plus in (0, 1) if self._addend is None else (self._addend >> bit & 1,):
                sums = [
                    (number >> bit & 1 ^ flip) + plus + carry
                    for number, carry in zip(self._numbers, carries, strict=True)
                ]
                turned = {total & 1 ^ want for total, want in zip(sums, wanted, strict=True)}
                is_kept = len(turned) == 1 and turned <= set(self._kind.xors)
                if not is_kept and (not self._kind.mask or len(set(wanted)) > 1):
                    continue
                rest = self._from(bit + 1, tuple(total >> 1 for total in sums))
                if rest is not None:
                    step = (flip, plus, is_kept, turned.pop() if is_kept else wanted[0])
                    flips, addend, mask, xorout = (part | one << bit for part, one in zip(rest, step, strict=True))
                    return flips, addend, mask, xorout
        self._dead.add((bit, carries))
        return None
