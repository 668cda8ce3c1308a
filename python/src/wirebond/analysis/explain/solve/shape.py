"""The way in which a CRC processes bytes and outputs its value: everything but its polynomial, first value and last
steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

from wirebond.analysis.explain.solve.last_steps import LastSteps
from wirebond.analysis.explain.solve.polynomials import remainder
from wirebond.analysis.explain.solve.sample import Order, reflected, words
from wirebond.protocol.model import Algorithm, ByteOrder, CheckKind, OddTail

_WIDEST_OF_WORDS = 32  # bits


@dataclass(frozen=True)
class Shape:
    """``unit``: bytes of a word, in this ``order``."""

    width: int
    refin: bool
    refout: bool
    unit: int
    order: Order

    def entering(self, covered: bytes) -> bytes:
        """Return the bytes in the order in which their bits enter the register, the highest bit first."""
        if self.unit > 1:
            covered += bytes(-len(covered) % self.unit)
            inside: Order = "little" if self.refin else "big"
            covered = b"".join(word.to_bytes(self.unit, inside) for word in words(covered, self.unit, self.order))
        return bytes(reflected(byte, 8) for byte in covered) if self.refin else covered

    def turned(self, value: int) -> int:
        """Convert the register to its value, or back."""
        return reflected(value, self.width) if self.refout else value

    def value(self, entering: bytes, polynomial: int, init: int) -> int:
        """Compute the value after these bytes, before the last steps."""
        begun = int.from_bytes(entering, "big") << self.width ^ init << 8 * len(entering)
        return self.turned(remainder(begun, polynomial))

    def algorithm(self, polynomial: int, init: int, size: int, steps: LastSteps) -> Algorithm:
        """Return the algorithm in the form of a file. If bits of the value are inverted before the last steps, the
        register began with another ``init``: the one that leaves just these bits after ``size`` bytes, the size of all
        frames.
        """
        if steps.flips:
            init ^= _before(self.turned(steps.flips), size, polynomial)
        every = (1 << self.width) - 1
        return Algorithm(
            CheckKind.CRC.value,
            CheckKind.CRC,
            self.width,
            poly=polynomial & every,
            init=init,
            refin=self.refin,
            refout=self.refout,
            xorout=steps.xorout,
            negate=steps.negate,
            plus=steps.plus,
            mask=None if steps.mask == every else steps.mask,
            unit=self.unit,
            unit_order=ByteOrder.LITTLE if self.order == "little" else ByteOrder.BIG,
            odd=OddTail.PAD,
        )


def shapes(width: int) -> Iterator[Shape]:
    """Yield all shapes, the usual ones first."""
    reflections = sorted(product((False, True), repeat=2), key=lambda one: one[0] != one[1])
    for unit in (1, 2, 4) if width <= _WIDEST_OF_WORDS else (1,):
        orders: tuple[Order, ...] = ("little", "big") if unit > 1 else ("little",)
        for (refin, refout), order in product(reflections, orders):
            yield Shape(width, refin, refout, unit, order)


def _before(register: int, size: int, polynomial: int) -> int:
    """Return the register ``size`` zero bytes earlier: each step back divides by x."""
    for _ in range(8 * size):
        register = (register ^ polynomial if register & 1 else register) >> 1
    return register
