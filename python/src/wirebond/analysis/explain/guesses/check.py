"""Guesses at a check: other ranges, another byte order, another algorithm, the way another protocol does it."""

from __future__ import annotations

import string
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

from wirebond.analysis.explain.guesses.guess import Case, Guess, Guesses, spelled, with_part
from wirebond.analysis.explain.layout import (
    CONSTANTS,
    check_value,
    covered_bytes,
    found_check,
    payload_index,
    same_check,
    shown_check,
    spans,
)
from wirebond.analysis.explain.solve import Sample, Solution, solve
from wirebond.analysis.explain.stuffing import stuff
from wirebond.protocol.algorithms import ALGORITHMS, in_order
from wirebond.protocol.model import Algorithm, ByteOrder, CheckKind, Part, PartKind
from wirebond.protocol.spelling import ranges_text

Ranges = tuple[tuple[int, int], ...]
_HEX_DIGITS = string.hexdigits.encode()


@dataclass(frozen=True)
class _Failed:
    """The check that does not hold, and its bytes."""

    index: int
    parts: tuple[Part, ...]
    found: bytes
    places: list[tuple[int, int]]
    seed: int

    @property
    def part(self) -> Part:
        return self.parts[self.index]

    @property
    def is_value(self) -> bool:
        """False: the check is sent as hex digits, and the received characters are not hex digits."""
        return not self.part.as_hex or all(byte in _HEX_DIGITS for byte in self.found)

    def covered(self, data: bytes, ranges: Ranges | None = None) -> bytes:
        """Return the covered bytes. ``ranges``: others than the file's own."""
        parts = self.parts
        if ranges is not None:
            parts = (*parts[: self.index], replace(self.part, ranges=ranges), *parts[self.index + 1 :])
        return covered_bytes(parts, self.index, data, self.places)


def _failed(case: Case) -> _Failed | None:
    index = case.failed_check
    verdict = case.verdict
    if index is None or verdict is None or verdict.payload is None:
        return None
    places = spans(case.parts, verdict.payload_size or 0)
    found = found_check(case.parts, index, case.data, places)
    return _Failed(index, case.parts, found, places, verdict.seed)


@dataclass(frozen=True)
class Solved:
    """One check for all frames. ``guesses``: by the index of the case."""

    guesses: dict[int, Guess]
    solution: Solution


def _ranges(case: Case, failed: _Failed) -> Iterator[tuple[int, int]]:
    """Yield every range of parts that a file can name for this check, nearest to the file's own first. Left out are the
    file's own, those without a byte and, for a check over the payload, those without the payload."""
    count = len(case.parts)
    payload = payload_index(case.parts)
    needs_payload = payload in failed.part.covered and len(set(failed.places[payload])) > 1
    near_first, near_last = _outer(failed.part)
    in_reach = len([place for place in failed.places if place[1] <= len(case.data)])
    found = []
    for first in range(count):
        for last in range(first, min(count, in_reach)):
            holds_itself = first <= failed.index <= last
            if failed.part.in_bits is not None:  # it may cover the part that has its bits
                holds_itself = failed.index in (first, last + 1)
            empty = failed.places[first][0] == failed.places[last][1]
            skips_payload = needs_payload and not first <= payload <= last
            own = ((first, last),) == failed.part.ranges
            if holds_itself or empty or skips_payload or own:
                continue
            later_check = any(case.parts[i].kind == PartKind.CHECK and i > failed.index for i in range(first, last + 1))
            if not later_check:
                found.append((first, last))
    found.sort(key=lambda r: (abs(r[0] - near_first) + abs(r[1] - near_last), r))
    yield from found


def _outer(part: Part) -> tuple[int, int]:
    """Return the first and the last part that a check covers."""
    return min(part.covered, default=0), part.last_covered


def _over(case: Case, part: Part) -> str:
    return f"`{ranges_text(case.parts, part.ranges)}`"


def _difference(case: Case, mine: Part, other: Part) -> str:
    """Write the difference of two ranges: ``, without the id`` or ``, the tail too``."""
    own, theirs = set(mine.covered), set(other.covered)
    less = [case.parts[i].name for i in sorted(own - theirs)]
    more = [case.parts[i].name for i in sorted(theirs - own)]
    text = f", without the {' and the '.join(less)}" if less else ""
    return text + (f", and the {' and the '.join(more)} too" if more else "")


def _replaced(case: Case, failed: _Failed, part: Part) -> Guess | None:
    """Return the guess with this check part, unless its value differs: then nothing need be examined."""
    if not same_check(part, check_value(part, failed.covered(case.data, part.ranges), failed.seed), failed.found):
        return None
    protocol = with_part(case.protocol, case.parts, failed.index, part)
    for index, other in enumerate(case.parts):  # a sender with another algorithm uses it for every check
        if other.kind == PartKind.CHECK and index != failed.index and other.algorithm == failed.part.algorithm:
            same = replace(other, algorithm=part.algorithm, order=part.order)
            protocol = with_part(protocol, case.parts, index, same)

    changes = []
    if part.algorithm != failed.part.algorithm and part.algorithm is not None:
        is_own = part.algorithm.name not in ALGORITHMS
        changes.append(f"is {part.algorithm.name}" + " with parameters of its own" * is_own)
    if part.shift != failed.part.shift:
        changes.append("sends the high byte" if part.shift else "sends the low byte")
    if part.order != failed.part.order and part.size > 1:
        changes.append("has its " + ("high" if part.order == ByteOrder.BIG else "low") + " byte first")
    if part.seeded != failed.part.seeded:
        changes.append("counts no seed")
    how = " and ".join(changes) if changes else "is taken"
    over = f"over {_over(case, part)}{_difference(case, failed.part, part)}"
    what = f"the {part.name} {shown_check(part, failed.found)} fits if it {how} {over}"
    return Guess(protocol, case.block, case.sender, what, f"write {spelled(protocol, part.name)}")


def near_ranges(case: Case) -> Guesses:
    """Guess ranges near the file's own: one end moved by one part, constants or header left out, or all earlier
    parts."""
    failed = _failed(case)
    if failed is None:
        return
    for first, last in _near(case, failed):
        yield _replaced(case, failed, replace(failed.part, ranges=((first, last),)))
    yield from _with_gaps(case, failed)


def _near(case: Case, failed: _Failed) -> Iterator[tuple[int, int]]:
    parts = case.parts
    first, last = _outer(failed.part)
    near = {(first + 1, last), (first, last - 1), (first, last + 1), (first - 1, last), (0, failed.index - 1)}
    payload = payload_index(parts)
    near |= {(payload, payload), (payload, last)}
    no_magic = next((i for i, p in enumerate(parts) if p.kind not in CONSTANTS), 0)
    near.add((no_magic, last))
    return (one for one in _ranges(case, failed) if one in near)


def _with_gaps(case: Case, failed: _Failed) -> Guesses:
    """Guess ranges with a gap: up to the frame's end around the check itself, or with one part left out."""
    part, parts = failed.part, case.parts
    first, last = _outer(part)
    for gap in range(first + 1, last):
        if gap != failed.index:
            yield _replaced(case, failed, replace(part, ranges=_without(first, last, {gap, failed.index})))
    if failed.index < len(parts) - 1 and failed.places[-1][1] <= len(case.data):
        around = _without(first, len(parts) - 1, {failed.index})
        yield _replaced(case, failed, replace(part, ranges=around))
        yield _with_itself_as_zeros(case, failed, around)


def _without(first: int, last: int, gaps: set[int]) -> Ranges:
    """Split ``first`` to ``last`` into ranges that leave the gaps out."""
    found: list[tuple[int, int]] = []
    for index in range(first, last + 1):
        if index in gaps:
            continue
        if found and found[-1][1] == index - 1:
            found[-1] = found[-1][0], index
        else:
            found.append((index, index))
    return tuple(found)


def _with_itself_as_zeros(case: Case, failed: _Failed, around: Ranges) -> Guess | None:
    if failed.part.in_bits is not None:  # they count as zeros
        return None
    pieces = [failed.covered(case.data, (one,)) for one in around]
    position = sum(last < failed.index for _, last in around)
    covered = b"".join([*pieces[:position], bytes(failed.part.size), *pieces[position:]])
    if not same_check(failed.part, check_value(failed.part, covered, failed.seed), failed.found):
        return None
    start, stop = failed.places[failed.index]
    held = check_value(failed.part, failed.covered(case.data), failed.seed)
    repaired_data = case.data[:start] + held + case.data[stop:]  # so that the examination continues after this check

    names = ranges_text(case.parts, around)
    shown = shown_check(failed.part, failed.found)
    what = f"the {failed.part.name} {shown} fits if it covers `{names}` and itself, as zeros"
    remedy = "no `over:` can say that, for no check covers itself; the sender must leave it out"
    block = stuff(case.protocol.format, repaired_data)
    return Guess(case.protocol, block, case.sender, what, remedy, key=f"{remedy}: {names}")


def byte_orders(case: Case) -> Guesses:
    """Try the same check with swapped bytes, or with another byte of its value."""
    failed = _failed(case)
    if failed is None:
        return
    yield from (_replaced(case, failed, part) for part in _other_spelling(failed.part))


def seeds(case: Case) -> Guesses:
    """Guess that the message's seed is another one, or none at all: its definition differs on the two ends."""
    failed = _failed(case)
    message = None if case.verdict is None else case.verdict.message
    if failed is None or message is None or not failed.part.seeded:
        return
    covered = failed.covered(case.data)
    for seed in range(256):
        if not same_check(failed.part, check_value(failed.part, covered, seed), failed.found):
            yield None
            continue
        other = replace(message, seed=seed)
        messages = tuple(other if known is message else known for known in case.protocol.messages)
        what = f"the {failed.part.name} fits if the seed of {message.name} is {seed}, not {message.seed or 0}"
        remedy = f"write `seed: {seed}` in {message.name}, or compare its fields with the other end's definition"
        yield Guess(replace(case.protocol, messages=messages), case.block, case.sender, what, remedy)
    yield _replaced(case, failed, replace(failed.part, seeded=False))


def _other_spelling(part: Part) -> list[Part]:
    """Return other ways to put the same value on the wire."""
    assert part.algorithm is not None
    if part.as_hex or part.as_decimal:
        return []
    if part.size > 1:
        order = ByteOrder.LITTLE if part.order == ByteOrder.BIG else ByteOrder.BIG
        return [replace(part, order=order, algorithm=in_order(part.algorithm, order))]
    if part.algorithm.width > 8:
        return [replace(part, shift=0 if part.shift else part.algorithm.width - 8)]
    return []


def _with_algorithm(part: Part, algorithm: Algorithm) -> list[Part]:
    """Return the part with another algorithm whose value, or one byte of it, fits its place."""
    if part.algorithm is not None and replace(algorithm, unit_order=part.algorithm.unit_order) == part.algorithm:
        return []
    if part.in_bits is not None:
        is_short = part.shift + part.in_bits.width <= algorithm.width <= max(part.in_bits.width, 8)
        return [replace(part, algorithm=in_order(algorithm, part.order))] if is_short else []
    size = part.size // 2 if part.as_hex else part.size
    if (algorithm.width + 7) // 8 == size:
        other = replace(part, algorithm=in_order(algorithm, part.order), shift=0)
        return [other, *(_other_spelling(other) if size > 1 else [])]
    if size == 1 and algorithm.kind == CheckKind.SUM:
        return [replace(part, algorithm=algorithm, shift=algorithm.width - 8)]
    return []


def algorithms_of_its_kind(case: Case) -> Guesses:
    """Guess a CRC for a CRC, a sum for a sum, over the file's own range."""
    yield from _algorithms(case, same_kind=True)


def algorithms_of_other_kinds(case: Case) -> Guesses:
    yield from _algorithms(case, same_kind=False)


def _algorithms(case: Case, *, same_kind: bool) -> Guesses:
    failed = _failed(case)
    if failed is None or failed.part.algorithm is None:
        return
    for algorithm in ALGORITHMS.values():
        if (algorithm.kind == failed.part.algorithm.kind) == same_kind:
            yield from (_replaced(case, failed, part) for part in _with_algorithm(failed.part, algorithm))


def all_ranges(case: Case) -> Guesses:
    """Guess the file's own algorithm over every other range."""
    failed = _failed(case)
    if failed is None:
        return
    for first, last in _ranges(case, failed):
        for part in (failed.part, *_other_spelling(failed.part)):
            yield _replaced(case, failed, replace(part, ranges=((first, last),)))


def all_algorithms_and_ranges(case: Case) -> Guesses:
    failed = _failed(case)
    if failed is None:
        return
    for first, last in _ranges(case, failed):
        for algorithm in ALGORITHMS.values():
            for part in _with_algorithm(failed.part, algorithm):
                yield _replaced(case, failed, replace(part, ranges=((first, last),)))


def solved(cases: Sequence[Case], *, thorough: bool) -> Solved | None:
    """Return the check whose parameters follow from the frames: over the file's own range, or else over a near one.

    None where the catalogue's algorithms are all that these frames can tell, as too few of them have such a check.
    """
    failed = {
        index: found for index, case in enumerate(cases) if (found := _failed(case)) is not None and found.is_value
    }
    names = Counter(found.part.name for found in failed.values())
    alike = {index: found for index, found in failed.items() if found.part.name == names.most_common(1)[0][0]}
    if not alike:
        return None
    index, one = next(iter(alike.items()))
    if one.part.seeded or one.part.algorithm is None or one.part.in_bits is not None:
        return None
    own = one.part.ranges
    size = one.part.size // 2 if one.part.as_hex else one.part.size
    has_one_order = size == 1 or one.part.as_hex or one.part.as_decimal
    orders = [one.part.order] if has_one_order else sorted(ByteOrder, key=lambda o: o != one.part.order)
    ways = [(*way, False) for way in product([own, *((near,) for near in _near(cases[index], one))], orders)]
    ways += [(own, one.part.order, True)] * thorough
    for ranges, order, takes_seconds in ways:
        covered = [found.covered(cases[i].data, ranges) for i, found in alike.items()]
        samples = [Sample(data, _number(found, order)) for data, found in zip(covered, alike.values(), strict=True)]
        solution = solve(samples, size, thorough=takes_seconds)
        if solution is not None:
            part = replace(one.part, algorithm=solution.algorithm, order=order, shift=0, ranges=ranges)
            guesses = {i: _replaced(cases[i], found, part) for i, found in alike.items()}
            return Solved({i: guess for i, guess in guesses.items() if guess is not None}, solution)
    return None


def _number(failed: _Failed, order: ByteOrder) -> int:
    """Return the received check value."""
    if failed.part.as_hex:
        return int(failed.found, 16)
    return int.from_bytes(failed.found, "big" if order == ByteOrder.BIG else "little")


def as_peers_check(case: Case) -> Guesses:
    """Guess the check of another protocol file, if its range has names that this frame has too."""
    failed = _failed(case)
    if failed is None or failed.part.in_bits is not None:
        return
    names = [part.name for part in case.parts]
    seen = {_replaced_key(failed.part)}
    for peer in case.peers:
        for theirs in peer.format.parts:
            if (
                theirs.kind != PartKind.CHECK
                or theirs.in_bits is not None
                or theirs.size != failed.part.size
                or _written(theirs) != _written(failed.part)
            ):
                continue
            ends = [peer.format.parts[index].name for both in theirs.ranges for index in both]
            if any(name not in names for name in ends):
                continue
            numbers = [names.index(name) for name in ends]
            ranges = tuple(zip(numbers[::2], numbers[1::2], strict=True))
            part = replace(theirs, name=failed.part.name, ranges=ranges, condition=failed.part.condition)
            reachable = all(first <= last for first, last in ranges) and failed.index not in part.covered
            if _replaced_key(part) in seen or not reachable or failed.places[max(numbers)][1] > len(case.data):
                continue
            seen.add(_replaced_key(part))
            guess = _replaced(case, failed, part)
            named = None if guess is None else replace(guess, what=f"{guess.what}; {peer.name} computes it so")
            yield named


def _written(part: Part) -> tuple[bool, bool]:
    return part.as_hex, part.as_decimal


def _replaced_key(part: Part) -> tuple[Algorithm | None, ByteOrder, int, Ranges]:
    return part.algorithm, part.order, part.shift, part.ranges
