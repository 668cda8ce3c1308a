"""CRCs with polynomials of their own, solved from frames.

Frames of one length differ by a multiple of the polynomial, so the greatest common divisor of their differences is
the polynomial itself. CRC RevEng by Greg Cook finds it in that way.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import reduce
from itertools import product
from operator import xor

from wirebond.analysis.explain.solve import polynomials
from wirebond.analysis.explain.solve.last_steps import last_steps
from wirebond.analysis.explain.solve.sample import LEAST_SAMPLES, Sample
from wirebond.analysis.explain.solve.shape import Shape, shapes
from wirebond.analysis.explain.solve.trial import crc_by_trial
from wirebond.protocol.model import Algorithm

_NARROWEST = 3  # bits
_MOST_FREE = 3  # bits of init that nothing determines


def crcs(samples: Sequence[Sample], width: int, *, thorough: bool) -> Iterator[Algorithm]:
    """Yield the first CRC of this width that all samples have. ``thorough``: also one over bytes whose last steps hide
    its polynomial, which takes seconds.
    """
    if width < _NARROWEST or max(sample.value for sample in samples) >> width:
        return
    ways = [(_crc_by_divisor, shape) for shape in shapes(width)]
    ways += [(crc_by_trial, shape) for shape in shapes(width) if thorough and shape.unit == 1]
    for find, shape in ways:
        found = find(samples, shape)
        if found is not None:
            yield found
            return


def _crc_by_divisor(samples: Sequence[Sample], shape: Shape) -> Algorithm | None:
    entering = [shape.entering(sample.covered) for sample in samples]
    values = [sample.value for sample in samples]
    same_size = len({len(data) for data in entering}) == 1
    for chosen, registers in _linear(values, shape.width):
        pairs = [(entering[i], shape.turned(register)) for i, register in zip(chosen, registers, strict=True)]
        for polynomial in polynomials.divisors_of_degree(_common_divisor(pairs, shape.width), shape.width):
            for init in _beginnings(pairs, polynomial, shape.width):
                found = [shape.value(data, polynomial, init) for data in entering]
                steps = last_steps(found, values, shape.width, flips=same_size)
                if steps is not None:
                    return shape.algorithm(polynomial, init, len(entering[0]), steps)
    return None


def _linear(values: Sequence[int], width: int) -> Iterator[tuple[Sequence[int], Sequence[int]]]:
    """Yield samples, by their indices, and their registers but for one constant: all; all negated; or, since a negated
    odd number is the number with every bit but the lowest turned, those whose lowest bit is alike."""
    every = range(len(values))
    yield every, values
    yield every, [-value & (1 << width) - 1 for value in values]
    for lowest in (0, 1):
        alike = [index for index in every if values[index] & 1 == lowest]
        if len(alike) >= LEAST_SAMPLES - 1:
            yield alike, [values[index] for index in alike]


def _common_divisor(pairs: Sequence[tuple[bytes, int]], width: int) -> int:
    """Return a number that the polynomial divides, for any ``init`` and final xor.

    Of two frames, message times x^width plus register differ by a multiple of the polynomial plus ``init`` times
    x^length plus x^length'. Of two such differences, each times the other's lengths, ``init`` vanishes.
    """
    numbers = [(int.from_bytes(data, "big") << width ^ register, 1 << 8 * len(data)) for data, register in pairs]
    (first, length), *others = numbers
    differences = [(first ^ number, length ^ other) for number, other in others]
    number, lengths = max(differences, key=lambda difference: difference[1])
    common = 0
    for other, others_lengths in differences:
        if not others_lengths:
            common = polynomials.common_divisor(common, other)
        elif (other, others_lengths) != (number, lengths):
            multiple = polynomials.product(other, lengths) ^ polynomials.product(number, others_lengths)
            shared = polynomials.common_divisor(lengths, others_lengths)
            common = polynomials.common_divisor(common, polynomials.quotient(multiple, shared))
    return common


def _beginnings(pairs: Sequence[tuple[bytes, int]], polynomial: int, width: int) -> Iterator[int]:
    """Yield possible first values of the register: the usual ones, and those that follow from frames of several
    lengths."""
    yield 0
    yield (1 << width) - 1
    rest = [
        (len(data), register ^ polynomials.remainder(int.from_bytes(data, "big") << width, polynomial))
        for data, register in pairs
    ]
    yield from sorted(_solved(rest, polynomial, width), key=int.bit_count)  # the simplest first


def _solved(rest: Sequence[tuple[int, int]], polynomial: int, width: int) -> Iterator[int]:
    """Yield each ``init`` with which all lengths have one final xor, by Gauss's elimination over GF(2). There are
    several if the polynomial has the factor x + 1: lengths do not distinguish those."""
    (first, constant), *others = rest
    rows: dict[int, tuple[int, int]] = {}  # by the pivot: which bits of init turn a bit, and whether they must
    for size, other in others:
        turned = [polynomials.remainder(1 << bit + 8 * size ^ 1 << bit + 8 * first, polynomial) for bit in range(width)]
        for place in range(width):
            mask = sum((turn >> place & 1) << bit for bit, turn in enumerate(turned))
            want = (constant ^ other) >> place & 1
            for pivot, (known, value) in rows.items():
                if mask >> pivot & 1:
                    mask, want = mask ^ known, want ^ value
            if not mask:
                if want:
                    return
                continue
            pivot = mask.bit_length() - 1
            for old, (known, value) in rows.items():
                if known >> pivot & 1:
                    rows[old] = known ^ mask, value ^ want
            rows[pivot] = mask, want
    free = [bit for bit in range(width) if bit not in rows]
    if len(free) > _MOST_FREE:
        return
    base = sum(value << pivot for pivot, (_, value) in rows.items())
    ways = [1 << bit | sum((known >> bit & 1) << pivot for pivot, (known, _) in rows.items()) for bit in free]
    for chosen in product((False, True), repeat=len(ways)):
        yield reduce(xor, (way for way, is_chosen in zip(ways, chosen, strict=True) if is_chosen), base)
