"""Sums, xors and Fletcher's sums with parameters of their own, solved from frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import accumulate

from wirebond.analysis.explain.solve.last_steps import LastSteps, last_steps
from wirebond.analysis.explain.solve.sample import Order, Sample, tail, words
from wirebond.protocol.model import Algorithm, ByteOrder, CheckKind, OddTail

_MODULI = (255, 100, 256, 65521, 65535)
_FULL = 0  # as a modulus: 2 ** width
_WIDEST = 32  # bits


def sums(samples: Sequence[Sample], width: int) -> Iterator[Algorithm]:
    """Yield every sum, xor and Fletcher's sum of this width that fits all samples, the simplest first."""
    if width > _WIDEST:
        return
    for unit, order, odd in _ways(samples):
        yield from _xors(samples, width, unit, order, odd)
        yield from _plain_sums(samples, width, unit, order, odd)
        yield from _fletchers(samples, width, unit, order, odd)


def _ways(samples: Sequence[Sample]) -> Iterator[tuple[int, Order, OddTail]]:
    """Yield the words that are added, and the treatment of the bytes after the last."""
    for unit in (1, 2, 4):
        orders: tuple[Order, ...] = ("little", "big") if unit > 1 else ("little",)
        is_odd = any(tail(sample.covered, unit) for sample in samples)
        for order in orders:
            yield unit, order, OddTail.PAD
            if is_odd:
                yield unit, order, OddTail.XOR


def _numbers(sample: Sample, unit: int, order: Order, odd: OddTail) -> list[int]:
    covered = sample.covered
    if odd == OddTail.PAD and len(covered) % unit:
        covered += bytes(unit - len(covered) % unit)
    return words(covered, unit, order)


def _turned(sample: Sample, unit: int, odd: OddTail) -> int:
    """Return the bits that an odd tail changes in the register."""
    turned = 0
    if odd == OddTail.XOR:
        for byte in tail(sample.covered, unit):
            turned ^= byte
    return turned


def _algorithm(
    kind: CheckKind, width: int, unit: int, order: Order, odd: OddTail, steps: LastSteps, **own: int
) -> Algorithm:
    every = (1 << width) - 1
    return Algorithm(
        kind.value,
        kind,
        width,
        unit=unit,
        unit_order=ByteOrder.LITTLE if order == "little" else ByteOrder.BIG,
        odd=odd,
        negate=steps.negate,
        plus=steps.plus,
        mask=None if steps.mask == every else steps.mask,
        xorout=steps.xorout,
        init=own.get("init", steps.flips),
        modulus=own.get("modulus", 0),
        end_around=bool(own.get("end_around", False)),
    )


def _xors(samples: Sequence[Sample], width: int, unit: int, order: Order, odd: OddTail) -> Iterator[Algorithm]:
    if 8 * unit > width and unit > 1:
        return
    registers = []
    for sample in samples:
        register = _turned(sample, unit, odd)
        for number in _numbers(sample, unit, order, odd):
            register ^= number
        registers.append(register)
    values = [sample.value for sample in samples]
    for flips in (False, True):
        steps = last_steps(registers, values, width, flips=flips)
        if steps is not None:
            yield _algorithm(CheckKind.XOR, width, unit, order, odd, steps)
            return


def _plain_sums(samples: Sequence[Sample], width: int, unit: int, order: Order, odd: OddTail) -> Iterator[Algorithm]:
    totals = [sum(_numbers(sample, unit, order, odd)) for sample in samples]
    turned = [_turned(sample, unit, odd) for sample in samples]
    values = [sample.value for sample in samples]
    every = (1 << width) - 1
    steps = last_steps([total & every ^ flip for total, flip in zip(totals, turned, strict=True)], values, width)
    if steps is not None:
        yield _algorithm(CheckKind.SUM, width, unit, order, odd, steps)
        return
    for modulus in (_FULL, *(n for n in _MODULI if n <= every)):
        found = _with_beginning(totals, turned, values, width, modulus)
        if found is not None:
            init, steps = found
            yield _algorithm(
                CheckKind.SUM,
                width,
                unit,
                order,
                odd,
                steps,
                init=init,
                modulus=modulus,
                end_around=int(modulus == _FULL),
            )
            return


def _with_beginning(
    totals: Sequence[int], turned: Sequence[int], values: Sequence[int], width: int, modulus: int
) -> tuple[int, LastSteps] | None:
    """Find the first value and the last steps of a sum that wraps at another number than 2 ** width, or whose carry
    goes around.

    What it begins with moves the place at which it wraps: between the sums of two frames all places are alike.
    """
    every = (1 << width) - 1
    size = modulus or every
    beginnings = {0, 1}
    for value, total in zip(values, totals, strict=True):  # as if nothing were added or inverted afterwards
        beginnings |= {(sign * (value ^ turn) - total) % size for sign in (1, -1) for turn in (0, every)}
    beginnings |= {(size - total % size) % size for total in totals}  # from here on this frame's sum wraps
    for init in sorted(beginnings, key=lambda init: (init != 0, init)):
        registers = []
        for total, flip in zip(totals, turned, strict=True):
            whole = init + total
            register = whole % modulus if modulus else (whole and (whole - 1) % every + 1)
            registers.append(register ^ flip)
        steps = last_steps(registers, values, width)
        if steps is not None:
            return init, steps
    return None


def _fletchers(samples: Sequence[Sample], width: int, unit: int, order: Order, odd: OddTail) -> Iterator[Algorithm]:
    half = width // 2
    if width not in (8, 16, 32) or (8 * unit > half and unit > 1):
        return
    values = [sample.value for sample in samples]
    for modulus in (_FULL, *(n for n in (3, *_MODULI) if n <= 1 << half)):
        registers = []
        for sample in samples:
            first = list(accumulate(_numbers(sample, unit, order, odd)))
            size = modulus or 1 << half
            one, two = (first[-1] if first else 0) % size, sum(first) % size
            registers.append((two << half | one) ^ _turned(sample, unit, odd))
        steps = last_steps(registers, values, width)
        if steps is not None:
            yield _algorithm(CheckKind.FLETCHER, width, unit, order, odd, steps, init=0, modulus=modulus)
            return
