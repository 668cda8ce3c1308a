"""CRCs whose last steps hide the polynomial: every one of up to 16 bits is tried, all at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wirebond.analysis.explain.solve.last_steps import last_steps
from wirebond.analysis.explain.solve.sample import Sample
from wirebond.analysis.explain.solve.shape import Shape
from wirebond.protocol.algorithms import ALGORITHMS
from wirebond.protocol.model import Algorithm, CheckKind

Polynomials = np.ndarray[tuple[int], np.dtype[np.uint64]]  # without their highest term

_MOST_BITS = 16
_MOST_UNFILTERED = 1 << 8


def crc_by_trial(samples: Sequence[Sample], shape: Shape) -> Algorithm | None:
    """Return a CRC of this shape that all samples have. A wide one is looked for among the polynomials of the
    catalogue."""
    width = shape.width
    entering = [shape.entering(sample.covered) for sample in samples]
    values = [sample.value for sample in samples]
    same_size = len({len(data) for data in entering}) == 1
    for init in (0,) if same_size else (0, (1 << width) - 1):
        polynomials = _candidates(width)
        if len({value & 1 for value in values}) > 1:
            polynomials = _with_lowest_bit(entering, values, polynomials, init, shape)
        elif len(polynomials) > _MOST_UNFILTERED:  # the lowest bit is masked, so it does not help
            continue
        registers = [_registers(data, polynomials, width, init) for data in entering]
        for index, low in enumerate(polynomials):
            found = [shape.turned(int(register[index])) for register in registers]
            steps = last_steps(found, values, width, flips=same_size)
            if steps is not None:
                return shape.algorithm(int(low) | 1 << width, init, len(entering[0]), steps)
    return None


def _candidates(width: int) -> Polynomials:
    if width <= _MOST_BITS:
        return np.arange(1, 1 << width, 2, dtype=np.uint64)
    known = {one.poly for one in ALGORITHMS.values() if one.kind == CheckKind.CRC and one.width == width}
    return np.array(sorted(known), dtype=np.uint64)


def _with_lowest_bit(
    entering: Sequence[bytes], values: Sequence[int], polynomials: Polynomials, init: int, shape: Shape
) -> Polynomials:
    """Yield polynomials with which the lowest bit of every value is that of the register, or always its opposite: no
    carry affects it."""
    lowest = np.uint64(shape.width - 1 if shape.refout else 0)
    first: Polynomials | None = None
    for data, value in zip(entering, values, strict=True):
        register = _registers(data, polynomials, shape.width, init)
        differs = (register >> lowest ^ np.uint64(value)) & np.uint64(1)
        if first is None:
            first = differs
        else:
            alike = differs == first
            polynomials, first = polynomials[alike], first[alike]
    return polynomials


def _registers(data: bytes, polynomials: Polynomials, width: int, init: int) -> Polynomials:
    """Return the register after these bytes, for each polynomial."""
    one, top, every = np.uint64(1), np.uint64(width - 1), np.uint64((1 << width) - 1)
    register = np.full(len(polynomials), init, dtype=np.uint64)
    for byte in data:
        for bit in range(7, -1, -1):
            carry = register >> top ^ np.uint64(byte >> bit & 1)
            register = (register << one & every) ^ carry * polynomials
    return register
