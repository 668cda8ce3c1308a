"""The forms of a frame: each is a set of parts, with the conditions for it. No offsets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

from wirebond.protocol.model.fields import End
from wirebond.protocol.model.frames import (
    SENDER_NUMBERS,
    BitRole,
    Comparison,
    Condition,
    HeaderField,
    Part,
    PartKind,
    Subject,
)

MAX_SIZE = 0xFFFF  # payload bytes

Intervals = tuple[tuple[int, int], ...]  # rising and apart, both bounds included


@dataclass(frozen=True)
class Choice:
    """A condition for a form: ``subject & mask`` is in one of the intervals ``allowed``.

    ``subject`` is a header field, the id or the payload's size: what a magic and a sender decide is decided.
    """

    subject: Subject
    name: str  # of the header field
    mask: int  # all bits of the number, where no others are asked for
    allowed: Intervals

    def holds(self, value: int) -> bool:
        return any(low <= value & self.mask <= high for low, high in self.allowed)

    @property
    def number(self) -> tuple[Subject, str]:
        return self.subject, self.name

    @property
    def fixed_bits(self) -> tuple[int, int] | None:
        """Mask and value of the bits that say the same; None where bits cannot say it."""
        if len(self.allowed) != 1:
            return None
        low, high = self.allowed[0]
        varying = low ^ high
        if varying & (varying + 1) or low & varying or high != low | varying:
            return None  # not all numbers with the same upper bits
        return self.mask & ~varying, low & ~varying


@dataclass(frozen=True)
class FormParts:
    """The parts of one form, with one magic, and what must be so of a frame that has it."""

    parts: tuple[Part, ...]
    choices: tuple[Choice, ...]

    @property
    def bytes_beside_payload(self) -> int:
        return sum(part.size for part in self.parts if part.kind != PartKind.PAYLOAD)


def parts_of_forms(parts: tuple[Part, ...], sender: End | None) -> list[FormParts]:
    """Return every form that a frame of this sender can take, the default one first."""
    return list(_parts_of_forms(parts, sender))


@lru_cache(maxsize=512)
def _parts_of_forms(parts: tuple[Part, ...], sender: End | None) -> tuple[FormParts, ...]:
    found: dict[FormParts, None] = {}
    for end in _ends(sender):
        for magic_part, magic in _magic_choices(parts, end):
            for form in _Growth(parts, end, magic_part, magic).forms():
                found.setdefault(form)
    defaults = {field.name: field.default_bits(sender) for field in header_fields(parts)}

    def unusual(form: FormParts) -> int:
        return sum(
            not choice.holds(defaults[choice.name]) for choice in form.choices if choice.subject == Subject.FIELD
        )

    return tuple(sorted(found, key=unusual))


def own_forms(parts: tuple[Part, ...], sender: End | None) -> int:
    """Return how many of the forms have the header's default values: the first ones."""
    defaults = {field.name: field.default_bits(sender) for field in header_fields(parts)}
    return sum(
        all(choice.holds(defaults[choice.name]) for choice in form.choices if choice.subject == Subject.FIELD)
        for form in parts_of_forms(parts, sender)
    )


def header_of(part: Part) -> list[HeaderField]:
    """Return the header fields that this part holds."""
    held = [part.header, *(run.header for run in part.bits)]
    return [field for field in held if field is not None]


def header_fields(parts: tuple[Part, ...]) -> tuple[HeaderField, ...]:
    """Return all header fields of a format, including those that never share a frame. A field's place in it is its
    number."""
    found = {field.name: field for part in reversed(parts) for field in reversed(header_of(part))}
    return tuple(reversed(found.values()))


def header_names(part: Part) -> list[str]:
    """Return the names of the header fields that this part holds."""
    return [field.name for field in header_of(part)]


def magics(parts: tuple[Part, ...], sender: End | None) -> list[bytes]:
    """Return the values that the magic of a frame of this sender can have, the one that is sent first before others."""
    found = [value for end in _ends(sender) for _, value in _magic_choices(parts, end) if value]
    return list(dict.fromkeys(found))


def _ends(sender: End | None) -> tuple[End, ...]:
    return (sender,) if sender in (End.HOST, End.MCU) else (End.HOST, End.MCU)


def _magic_choices(parts: tuple[Part, ...], sender: End) -> list[tuple[Part | None, bytes]]:
    choices: list[tuple[Part | None, bytes]] = []
    for part in parts:
        if part.kind != PartKind.MAGIC:
            continue
        if part.condition is not None and _Growth(parts, sender, part, b"").truth(part.condition, (), ()) is False:
            continue
        if part.by_sender:
            choices += [(part, value) for end, value in part.by_sender if end == sender]
        else:
            choices += [(part, value) for value in part.alternatives or (part.value,)]
    has_magic = any(part.kind == PartKind.MAGIC for part in parts)
    return choices if has_magic else [(None, b"")]


# ---- from conditions to forms


@dataclass(frozen=True)
class _Growth:
    """Part by part: where a condition needs a number that is not known, both answers are followed."""

    parts: tuple[Part, ...]
    sender: End
    magic_part: Part | None
    magic: bytes

    def forms(self) -> Iterator[FormParts]:
        for present, choices in self._grow(0, (), ()):
            parts = tuple(self._with_magic(part) for part in present)
            yield FormParts(_renumbered(self.parts, parts), choices)

    def _with_magic(self, part: Part) -> Part:
        return replace(part, value=self.magic) if part is self.magic_part else part

    def _grow(
        self, index: int, present: tuple[Part, ...], choices: tuple[Choice, ...]
    ) -> Iterator[tuple[tuple[Part, ...], tuple[Choice, ...]]]:
        if index == len(self.parts):
            yield present, choices
            return
        part = self.parts[index]
        truth = True if part.condition is None else self.truth(part.condition, present, choices)
        if isinstance(truth, Comparison):
            width = self._width(truth, present)
            for choice in (_choice(truth, width, holds=False), _choice(truth, width, holds=True)):
                if can_be((*choices, choice), width):
                    yield from self._grow(index, present, _joined(choices, choice))
            return
        if part is self.magic_part and not truth:
            return  # such a frame begins with another magic
        yield from self._grow(index + 1, (*present, part) if truth else present, choices)

    def truth(self, condition: Condition, present: tuple[Part, ...], choices: tuple[Choice, ...]) -> bool | Comparison:
        """Return the answer, or the first comparison that it depends on."""
        open_one: Comparison | None = None
        for term in condition.terms:
            if isinstance(term, Condition):
                truth = self.truth(term, present, choices)
            else:
                truth = self._compared(term, present, choices)
            if truth is False:
                return condition.negated
            if isinstance(truth, Comparison) and open_one is None:
                open_one = truth
        return open_one if open_one is not None else not condition.negated

    def _compared(self, term: Comparison, present: tuple[Part, ...], choices: tuple[Choice, ...]) -> bool | Comparison:
        if term.subject == Subject.MAGIC:
            return bool(self.magic) and term.holds(int.from_bytes(self.magic, "big"))
        if term.subject == Subject.SENDER:
            return term.holds(SENDER_NUMBERS[self.sender])
        width = self._width(term, present)
        if width == 0:  # it is not there, so that no comparison with it holds
            return False
        known = [choice for choice in choices if choice.number == (term.subject, term.name)]
        for holds in (True, False):
            if not can_be((*known, _choice(term, width, holds=not holds)), width):
                return holds
        return term

    def _width(self, term: Comparison, present: tuple[Part, ...]) -> int:
        """Return the number of compared bits; 0 if these parts do not hold them."""
        if term.subject == Subject.SIZE:
            return MAX_SIZE.bit_length()
        for part in present:
            if term.subject == Subject.ID and part.kind == PartKind.ID:
                return 8 * part.size
            if term.subject == Subject.FIELD and part.header is not None and part.header.name == term.name:
                return 8 * part.size
            for run in part.bits:
                if term.subject == Subject.ID and run.role == BitRole.ID:
                    return run.width
                if term.subject == Subject.FIELD and run.header is not None and run.header.name == term.name:
                    return run.width
        return 0


def _choice(term: Comparison, width: int, *, holds: bool) -> Choice:
    everything = (1 << width) - 1
    mask = everything if term.mask is None else term.mask & everything
    allowed = meet(term.ranges, ((0, mask),))
    return Choice(term.subject, term.name, mask, allowed if holds else complement(allowed, mask))


def _joined(choices: tuple[Choice, ...], choice: Choice) -> tuple[Choice, ...]:
    """Join choices over the same bits into one."""
    for index, other in enumerate(choices):
        if (other.number, other.mask) == (choice.number, choice.mask):
            one = replace(other, allowed=meet(other.allowed, choice.allowed))
            return (*choices[:index], one, *choices[index + 1 :])
    return (*choices, choice)


def _renumbered(parts: tuple[Part, ...], present: tuple[Part, ...]) -> tuple[Part, ...]:
    """Renumber the parts that checks cover, which they name by index, for the parts that are left."""
    names = {part.name for part in present}
    kept = [i for i, part in enumerate(parts) if part.name in names]

    def place(index: int) -> int:
        return sum(1 for i in kept if i < index)

    def renumbered(ranges: tuple[tuple[int, int], ...]) -> tuple[tuple[int, int], ...]:
        left = tuple((place(first), place(last + 1) - 1) for first, last in ranges)
        return tuple(one for one in left if one[0] <= one[1]) or left[:1]

    return tuple(replace(p, ranges=renumbered(p.ranges)) if p.kind == PartKind.CHECK else p for p in present)


# ---- sets of numbers


def meet(one: Intervals, other: Intervals) -> Intervals:
    pairs = ((max(a, c), min(b, d)) for a, b in one for c, d in other)
    return tuple(sorted((low, high) for low, high in pairs if low <= high))


def complement(allowed: Intervals, most: int) -> Intervals:
    """Return the numbers from 0 to ``most`` that are not in ``allowed``."""
    found = []
    low = 0
    for start, stop in allowed:
        if start > low:
            found.append((low, start - 1))
        low = stop + 1
    return (*found, (low, most)) if low <= most else tuple(found)


def can_be(choices: tuple[Choice, ...], width: int) -> bool:
    """Check whether a number of this many bits meets all those of the last one's choices."""
    mine = tuple(choice for choice in choices if choice.number == choices[-1].number)
    return some_value(mine, width) is not None


@lru_cache(maxsize=4096)
def some_value(choices: tuple[Choice, ...], width: int, prefer: int = 0) -> int | None:
    """Return a number of this many bits for which all of these choices hold, with bits of ``prefer`` where possible."""
    seen: set[tuple[int, ...]] = set()

    def search(bit: int, value: int) -> int | None:
        """Search from the highest bit down; the bits above ``bit`` are decided."""
        below = (1 << bit) - 1
        state = [bit]
        for number, choice in enumerate(choices):
            low = value & choice.mask
            high = low | (choice.mask & below)
            fitting = [(a, b) for a, b in choice.allowed if a <= high and b >= low]
            if not fitting:
                return None
            whole = any(a <= low and high <= b for a, b in fitting)
            state += [] if whole else [number, low]
        if bit == 0:
            return value
        if tuple(state) in seen:  # the same question, asked and answered with no
            return None
        first = prefer >> (bit - 1) & 1
        for digit in (first, 1 - first):
            found = search(bit - 1, value | digit << (bit - 1))
            if found is not None:
                return found
        seen.add(tuple(state))
        return None

    return search(width, 0)
