"""A guess at what went wrong, and how it is tested: by the rules that refused the bytes, not by a rule of thumb."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from wirebond.analysis.explain.examine import examine
from wirebond.analysis.explain.layout import CONSTANTS
from wirebond.analysis.explain.sized import examine_sized
from wirebond.analysis.explain.stuffing import Impossible, unstuff
from wirebond.analysis.explain.values import read_fields, values_text
from wirebond.analysis.explain.verdict import Question, Verdict
from wirebond.protocol.model import (
    CheckKind,
    Comparison,
    Condition,
    End,
    FrameFormat,
    Part,
    PartKind,
    Protocol,
    Subject,
)
from wirebond.protocol.spelling import part_text


@dataclass(frozen=True)
class Case:
    """Bytes that were refused, from the candidate's first byte on; between delimiters, where the format has them.

    ``preface`` says what has been assumed already.
    """

    protocol: Protocol
    block: bytes
    sender: End | None
    peers: Sequence[Protocol] = ()
    offset: int = 0  # of the block's first byte, in all that was given
    preface: str = ""

    @cached_property
    def verdict(self) -> Verdict | None:
        """None where the stuffing cannot be undone."""
        found = look(self.protocol, self.block, self.sender)
        return None if found is None else found[0]

    @cached_property
    def data(self) -> bytes:
        """The frame's bytes, unstuffed; empty where they cannot be."""
        found = look(self.protocol, self.block, self.sender)
        return b"" if found is None else found[1]

    @property
    def parts(self) -> tuple[Part, ...]:
        """Those that are there, of a format whose frames differ."""
        return self.protocol.format.parts if self.verdict is None else self.verdict.parts

    @property
    def failed_check(self) -> int | None:
        """Index of the check part that does not hold, where all before it does."""
        rule = None if self.verdict is None else self.verdict.failed
        return rule.part if rule is not None and rule.question == Question.CHECK else None


# A text, or how to make it once the meaning of the bytes is known.
Text = str | Callable[[Verdict], str]


@dataclass(frozen=True)
class Guess:
    """``what`` and ``remedy`` are sentences without a capital and a stop. ``key``: the same for the same guess at
    another frame, where the remedy does not tell it."""

    protocol: Protocol
    block: bytes
    sender: End | None
    what: Text
    remedy: Text = ""
    key: str = ""


# None: a guess that was tried and could be excluded without an examination.
Guesses = Iterator[Guess | None]


def look(protocol: Protocol, block: bytes, sender: End | None) -> tuple[Verdict, bytes] | None:
    """Return the verdict on a block and its unstuffed bytes; None where the stuffing cannot be undone."""
    frame_format = protocol.format
    if frame_format.is_sized:
        sized = examine_sized(protocol, block, sender)
        return None if sized.verdict is None else (sized.verdict, sized.content.data)
    if frame_format.delimiter is None and not frame_format.ends_by_silence:
        return examine(protocol, block, sender), block
    content = unstuff(frame_format, block)
    if isinstance(content, Impossible):
        return None
    return examine(protocol, content.data, sender, block=block), content.data


# The verdict on a guess that fits, and the unstuffed bytes.
Fitting = tuple[Verdict, bytes]


def test(guess: Guess) -> Fitting | None:
    """Return the frame that the bytes are if the guess is right, or None.

    Bytes after the frame are taken only if its checks prove it: otherwise any bytes would hold some frame.
    """
    found = look(guess.protocol, guess.block, guess.sender)
    if found is None or not found[0].is_frame:
        return None
    verdict, data = found
    if verdict.extent != len(data) and evidence(verdict) < 256:
        return None
    return verdict, data


def evidence(verdict: Verdict, before: Verdict | None = None) -> int:
    """Return how many values all checks of the frame together can have: the reciprocal of a chance hit.

    Checks that held ``before`` the guess prove nothing for it and do not count.
    """
    held = {rule.part for rule in (before.rules if before is not None else ()) if rule.holds}
    product = 1
    for index, part in enumerate(verdict.parts):
        if part.kind == PartKind.CHECK and index not in held:
            covered = sum(verdict.parts[i].size for i in part.covered) + (verdict.payload_size or 0)
            product *= distinct_values(part, covered)
    return product


def distinct_values(part: Part, covered: int) -> int:
    """Return how many values a check can have over this many bytes: the high byte of a short sum has few."""
    values = 1 << part.check_bits
    if part.algorithm is not None and part.algorithm.kind == CheckKind.SUM:
        values = min(values, (255 * max(covered, 1) >> part.shift) + 1)
    return values


def reading(verdict: Verdict, data: bytes) -> str:
    """Write the frame's values: ``velocity: linear 0.5 m/s, angular 0 rad/s``; empty if the file has no message for
    it."""
    if verdict.delivered_as == "unknown" or verdict.message is None or verdict.payload is None:
        return ""
    values = values_text(read_fields(verdict.message, verdict.payload_of(data)))
    return f"{verdict.message.name}: {values}" if values else verdict.message.name


def with_format(protocol: Protocol, frame_format: FrameFormat) -> Protocol:
    return replace(protocol, format=frame_format)


def with_part(protocol: Protocol, parts: tuple[Part, ...], index: int, part: Part) -> Protocol:
    """Return the protocol with another part in place of ``parts[index]``; ``parts`` are those of one form of the
    frame."""
    whole = protocol.format.parts
    places = {known.name: place for place, known in enumerate(whole)}
    if part.kind == PartKind.CHECK:
        ranges = tuple((places[parts[first].name], places[parts[last].name]) for first, last in part.ranges)
        part = replace(part, ranges=ranges)
    if part.kind == PartKind.MAGIC:
        part = replace(part, alternatives=(), by_sender=())
        whole = tuple(_under(known, parts[index].value, part.value) for known in whole)
    at = places[parts[index].name]
    return with_format(protocol, replace(protocol.format, parts=(*whole[:at], part, *whole[at + 1 :])))


def _under(part: Part, old: bytes, new: bytes) -> Part:
    """Move a part from the magic ``old`` to ``new``: the form keeps its parts."""
    return part if part.condition is None else replace(part, condition=_with_magic(part.condition, old, new))


def _with_magic(condition: Condition, old: bytes, new: bytes) -> Condition:
    terms: list[Comparison | Condition] = []
    for term in condition.terms:
        if isinstance(term, Condition):
            terms.append(_with_magic(term, old, new))
        elif term.subject == Subject.MAGIC:
            number = int.from_bytes(new, "big")
            holds = term.holds(int.from_bytes(old, "big"))
            terms.append(replace(term, ranges=((number, number),) if holds else (), size=len(new)))
        else:
            terms.append(term)
    return replace(condition, terms=tuple(terms))


def spelled(protocol: Protocol, name: str) -> str:
    """Return the line of the `frame` section for the part of this name."""
    parts = protocol.format.parts
    return f"`- {part_text(parts, next(i for i, part in enumerate(parts) if part.name == name))}`"


def constants_as_found(case: Case) -> Case | None:
    """Return the case with every constant taken for what stands in its place; None where that changes nothing, or where
    the frame's size stays unknown."""
    protocol, assumed = case.protocol, []
    for _ in case.parts:  # each round lays one more part open
        found = look(protocol, case.block, case.sender)
        if found is None:
            return None
        verdict, _ = found
        rule = verdict.failed
        if rule is None or rule.question != Question.CONSTANT or rule.part is None:
            break
        part = verdict.parts[rule.part]
        if part.kind not in CONSTANTS:
            return None
        value = bytes.fromhex(rule.found)
        if len(value) != part.size:
            return None
        assumed.append((part.name, value))
        protocol = with_part(protocol, verdict.parts, rule.part, replace(part, value=value))
    if not assumed:
        return None
    names = " and ".join(f"{value.hex(' ').upper()} as {name}" for name, value in assumed)
    return replace(case, protocol=protocol, preface=f"with {names}, ")
