"""Guesses at a check: other ranges, another byte order, another algorithm, the way another protocol does it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

from wirebond.analysis.explain.guesses.guess import Case, Guess, Guesses, spelled, with_part
from wirebond.analysis.explain.layout import (
    CONSTANTS,
    check_value,
    payload_index,
    same_check,
    shown_check,
    spans,
)
from wirebond.analysis.explain.solve import Sample, Solution, solve
from wirebond.analysis.explain.stuffing import stuff
from wirebond.protocol.algorithms import ALGORITHMS, in_order
from wirebond.protocol.model import Algorithm, ByteOrder, CheckKind, Part, PartKind
from wirebond.protocol.spelling import range_text


@dataclass(frozen=True)
class _Failed:
    """The check that does not hold, and what stands there."""

    index: int
    part: Part
    found: bytes
    places: list[tuple[int, int]]
    seed: int

    def covered(self, data: bytes, first: int, last: int) -> bytes:
        return data[self.places[first][0] : self.places[last][1]]


def _failed(case: Case) -> _Failed | None:
    index = case.failed_check
    verdict = case.verdict
    if index is None or verdict is None or verdict.payload is None:
        return None
    places = spans(case.parts, verdict.payload_size or 0)
    start, stop = places[index]
    return _Failed(index, case.parts[index], case.data[start:stop], places, verdict.seed)


@dataclass(frozen=True)
class Solved:
    """One check for all frames. ``guesses``: by the index of the case."""

    guesses: dict[int, Guess]
    solution: Solution


def _ranges(case: Case, failed: _Failed) -> Iterator[tuple[int, int]]:
    """Every range of parts that a file can name for this check, but the file's own, those without a byte and, for a
    check over the payload, those without the payload; nearest to the file's own first."""
    count = len(case.parts)
    payload = payload_index(case.parts)
    needs_payload = failed.part.first <= payload <= failed.part.last and len(set(failed.places[payload])) > 1
    in_reach = len([place for place in failed.places if place[1] <= len(case.data)])
    found = []
    for first in range(count):
        for last in range(first, min(count, in_reach)):
            holds_itself = first <= failed.index <= last
            empty = failed.places[first][0] == failed.places[last][1]
            skips_payload = needs_payload and not first <= payload <= last
            own = (first, last) == (failed.part.first, failed.part.last)
            if holds_itself or empty or skips_payload or own:
                continue
            later_check = any(case.parts[i].kind == PartKind.CHECK and i > failed.index for i in range(first, last + 1))
            if not later_check:
                found.append((first, last))
    found.sort(key=lambda r: (abs(r[0] - failed.part.first) + abs(r[1] - failed.part.last), r))
    yield from found


def _over(case: Case, part: Part) -> str:
    return f"`{range_text(case.parts, part.first, part.last)}`"


def _difference(case: Case, mine: Part, other: Part) -> str:
    """``, without the id`` or ``, the tail too``: what one range has and the other has not."""
    own, theirs = set(range(mine.first, mine.last + 1)), set(range(other.first, other.last + 1))
    less = [case.parts[i].name for i in sorted(own - theirs)]
    more = [case.parts[i].name for i in sorted(theirs - own)]
    text = f", without the {' and the '.join(less)}" if less else ""
    return text + (f", and the {' and the '.join(more)} too" if more else "")


def _replaced(case: Case, failed: _Failed, part: Part) -> Guess | None:
    """The guess with this check part, unless its value differs: then nothing need be examined."""
    if not same_check(
        part, check_value(part, failed.covered(case.data, part.first, part.last), failed.seed), failed.found
    ):
        return None
    protocol = with_part(case.protocol, case.parts, failed.index, part)
    for index, other in enumerate(case.parts):  # whoever takes another algorithm takes it for every check
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
    """One end of the range moved by one part, constants or header left out, or all that precedes."""
    failed = _failed(case)
    if failed is None:
        return
    for first, last in _near(case, failed):
        yield _replaced(case, failed, replace(failed.part, first=first, last=last))
    yield from _with_gaps(case, failed)


def _near(case: Case, failed: _Failed) -> Iterator[tuple[int, int]]:
    part, parts = failed.part, case.parts
    near = {(part.first + 1, part.last), (part.first, part.last - 1), (part.first, part.last + 1)}
    near |= {(part.first - 1, part.last), (0, failed.index - 1)}
    payload = payload_index(parts)
    near |= {(payload, payload), (payload, part.last)}
    no_magic = next((i for i, p in enumerate(parts) if p.kind not in CONSTANTS), 0)
    near.add((no_magic, part.last))
    return (one for one in _ranges(case, failed) if one in near)


def _with_gaps(case: Case, failed: _Failed) -> Guesses:
    """Ranges that `over:` cannot name: up to the frame's end around the check itself, or with one part left out."""
    part, parts = failed.part, case.parts
    own = list(range(part.first, part.last + 1))
    everything = [i for i in range(part.first, len(parts)) if i != failed.index]
    selections = [[i for i in own if i != gap] for gap in own[1:-1]]
    if failed.index < len(parts) - 1 and failed.places[-1][1] <= len(case.data):
        selections.append(everything)
    for selection in selections:
        pieces = [failed.covered(case.data, i, i) for i in selection]
        around = selection == everything
        fillers = [b"", bytes(part.size)] if around else [b""]  # the check itself left out, or taken as zeros
        for filler in fillers:
            position = sum(1 for i in selection if i < failed.index)
            covered = b"".join([*pieces[:position], filler, *pieces[position:]])
            yield _around(case, failed, covered, selection, zeros=bool(filler))


def _around(case: Case, failed: _Failed, covered: bytes, selection: list[int], *, zeros: bool) -> Guess | None:
    if not same_check(failed.part, check_value(failed.part, covered, failed.seed), failed.found):
        return None
    names = ", ".join(case.parts[i].name for i in selection)
    itself = ", and itself as zeros" if zeros else ""
    start, stop = failed.places[failed.index]
    held = check_value(failed.part, failed.covered(case.data, failed.part.first, failed.part.last), failed.seed)
    repaired_data = case.data[:start] + held + case.data[stop:]  # so that the examination goes on behind this check

    what = f"the {failed.part.name} {shown_check(failed.part, failed.found)} fits if it covers {names}{itself}"
    remedy = "no `over:` can say that, for it names one unbroken range; the sender must cover one"
    block = stuff(case.protocol.format, repaired_data)
    return Guess(case.protocol, block, case.sender, what, remedy, key=f"{remedy}: {names}{itself}")


def byte_orders(case: Case) -> Guesses:
    """The same check with its bytes the other way round, or with another byte of its value."""
    failed = _failed(case)
    if failed is None:
        return
    yield from (_replaced(case, failed, part) for part in _other_spelling(failed.part))


def seeds(case: Case) -> Guesses:
    """The message's seed another one, or none at all: its definition differs on the two ends."""
    failed = _failed(case)
    message = None if case.verdict is None else case.verdict.message
    if failed is None or message is None or not failed.part.seeded:
        return
    covered = failed.covered(case.data, failed.part.first, failed.part.last)
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
    """The same value otherwise put on the wire."""
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
    """The part with another algorithm whose value, or one byte of it, fits its place."""
    if part.algorithm is not None and replace(algorithm, unit_order=part.algorithm.unit_order) == part.algorithm:
        return []
    size = part.size // 2 if part.as_hex else part.size
    if (algorithm.width + 7) // 8 == size:
        other = replace(part, algorithm=in_order(algorithm, part.order), shift=0)
        return [other, *(_other_spelling(other) if size > 1 else [])]
    if size == 1 and algorithm.kind == CheckKind.SUM:
        return [replace(part, algorithm=algorithm, shift=algorithm.width - 8)]
    return []


def algorithms_of_its_kind(case: Case) -> Guesses:
    """A CRC for a CRC, a sum for a sum, over the file's own range."""
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
    """The file's own algorithm over every other range."""
    failed = _failed(case)
    if failed is None:
        return
    for first, last in _ranges(case, failed):
        for part in (failed.part, *_other_spelling(failed.part)):
            yield _replaced(case, failed, replace(part, first=first, last=last))


def all_algorithms_and_ranges(case: Case) -> Guesses:
    failed = _failed(case)
    if failed is None:
        return
    for first, last in _ranges(case, failed):
        for algorithm in ALGORITHMS.values():
            for part in _with_algorithm(failed.part, algorithm):
                yield _replaced(case, failed, replace(part, first=first, last=last))


def solved(cases: Sequence[Case], *, thorough: bool) -> Solved | None:
    """The check whose parameters follow from the frames: over the file's own range, or else over a near one.

    None where the catalogue's algorithms are all that these frames can tell, as too few of them have such a check.
    """
    failed = {index: found for index, case in enumerate(cases) if (found := _failed(case)) is not None}
    names = Counter(found.part.name for found in failed.values())
    alike = {index: found for index, found in failed.items() if found.part.name == names.most_common(1)[0][0]}
    if not alike:
        return None
    index, one = next(iter(alike.items()))
    if one.part.seeded or one.part.algorithm is None:
        return None
    own = one.part.first, one.part.last
    size = one.part.size // 2 if one.part.as_hex else one.part.size
    has_one_order = size == 1 or one.part.as_hex or one.part.as_decimal
    orders = [one.part.order] if has_one_order else sorted(ByteOrder, key=lambda o: o != one.part.order)
    ways = [(*way, False) for way in product([own, *_near(cases[index], one)], orders)]
    ways += [(own, one.part.order, True)] * thorough
    for (first, last), order, takes_seconds in ways:
        covered = [found.covered(cases[i].data, first, last) for i, found in alike.items()]
        samples = [Sample(data, _number(found, order)) for data, found in zip(covered, alike.values(), strict=True)]
        solution = solve(samples, size, thorough=takes_seconds)
        if solution is not None:
            part = replace(one.part, algorithm=solution.algorithm, order=order, shift=0, first=first, last=last)
            guesses = {i: _replaced(cases[i], found, part) for i, found in alike.items()}
            return Solved({i: guess for i, guess in guesses.items() if guess is not None}, solution)
    return None


def _number(failed: _Failed, order: ByteOrder) -> int:
    """The value that stands as the check."""
    if failed.part.as_hex:
        return int(failed.found, 16)
    return int.from_bytes(failed.found, "big" if order == ByteOrder.BIG else "little")


def as_peers_check(case: Case) -> Guesses:
    """The check as another protocol file has it, where its range has names that this frame has too."""
    failed = _failed(case)
    if failed is None:
        return
    names = [part.name for part in case.parts]
    seen = {_replaced_key(failed.part)}
    for peer in case.peers:
        for theirs in peer.format.parts:
            if (
                theirs.kind != PartKind.CHECK
                or theirs.size != failed.part.size
                or _written(theirs) != _written(failed.part)
            ):
                continue
            ends = [peer.format.parts[theirs.first].name, peer.format.parts[theirs.last].name]
            if any(name not in names for name in ends):
                continue
            first, last = (names.index(name) for name in ends)
            part = replace(theirs, name=failed.part.name, first=first, last=last, condition=failed.part.condition)
            reachable = first <= last < len(names) and not first <= failed.index <= last
            if _replaced_key(part) in seen or not reachable or failed.places[last][1] > len(case.data):
                continue
            seen.add(_replaced_key(part))
            guess = _replaced(case, failed, part)
            named = None if guess is None else replace(guess, what=f"{guess.what}; {peer.name} computes it so")
            yield named


def _written(part: Part) -> tuple[bool, bool]:
    return part.as_hex, part.as_decimal


def _replaced_key(part: Part) -> tuple[Algorithm | None, ByteOrder, int, int, int]:
    return part.algorithm, part.order, part.shift, part.first, part.last
