"""The conditions of a frame's parts: the meaning of their names and values, and where the named parts may be."""

from __future__ import annotations

from collections.abc import Callable

from wirebond.protocol.model import (
    SENDER_NUMBERS,
    BitRole,
    Comparison,
    Condition,
    End,
    HeaderField,
    Part,
    PartKind,
    PayloadRule,
    Subject,
)
from wirebond.protocol.model.forms import header_fields, header_of
from wirebond.protocol.problems import Place, suggestion
from wirebond.protocol.spelling import bytes_text
from wirebond.protocol.text.conditions import ComparisonText, ConditionText, ValueText
from wirebond.protocol.text.matching import MatchText

Wrong = Callable[[Place, str], None]
_WORDS = {subject.value: subject for subject in Subject if subject != Subject.FIELD}
_MOST = 2**64 - 1


def read_condition(text: ConditionText, parts: list[Part], index: int, place: Place, wrong: Wrong) -> Condition | None:
    """Return the condition of ``parts[index]``; None after saying what is wrong. ``parts`` have their header fields."""
    try:
        return _Reader(parts, index).condition(text)
    except Fault as fault:
        wrong(place, str(fault))
        return None


class Fault(Exception):  # noqa: N818
    """A sentence for the file's author."""


class _Reader:
    def __init__(self, parts: list[Part], index: int) -> None:
        self._parts = parts
        self._part = parts[index]
        self._index = index
        self._fields = {field.name: field for field in header_fields(tuple(parts)) if not _is_magic(field, parts)}
        self._payload = next((i for i, part in enumerate(parts) if part.kind == PartKind.PAYLOAD), len(parts))

    def condition(self, text: ConditionText) -> Condition:
        terms = tuple(self.condition(t) if isinstance(t, ConditionText) else self._comparison(t) for t in text.terms)
        return Condition(terms, text.negated)

    def _comparison(self, text: ComparisonText) -> Comparison:
        if text.name in self._fields:
            return self._of_field(text, self._fields[text.name])
        subject = _WORDS.get(text.name)
        if subject == Subject.ID:
            return self._of_id(text)
        if subject is not None and text.mask is not None:
            raise Fault(f"`{text.name}` has no bits to select; compare it with `==` or `in`")
        if subject == Subject.MAGIC:
            return self._of_magic(text)
        if subject == Subject.SENDER:
            return self._of_sender(text)
        if subject == Subject.SIZE:
            return self._of_size(text)
        known = dict.fromkeys([*self._fields, *_WORDS])
        raise Fault(f"the header has no field `{text.name}`; {suggestion(text.name, known)}")

    def _of_field(self, text: ComparisonText, field: HeaderField) -> Comparison:
        self._stands_before(next(i for i, part in enumerate(self._parts) if field in header_of(part)), field.name)
        if field.is_sequence:
            raise Fault(
                f"`{field.name}` is a sequence number: the link gives it when the frame is whole already, so no part "
                "can depend on it; name another field of the header"
            )
        kind = "scaled" if field.value.is_scaled else "signed" if field.value.coding.is_signed else ""
        if kind and text.mask is None:
            raise Fault(f"`{field.name}` is {kind}; compare its bits, such as `{field.name} & 0x01`")
        names = dict(field.value.enum)
        ranges = self._ranges(text, field.value.width, names, f"`{field.name}`")
        return Comparison(Subject.FIELD, ranges, field.name, text.mask)

    def _of_id(self, text: ComparisonText) -> Comparison:
        widths = []
        for index, part in enumerate(self._parts):
            runs = [run.width for run in part.bits if run.role == BitRole.ID]
            found = [8 * part.size] if part.kind == PartKind.ID else runs
            if found:
                self._stands_before(index, "id")
            widths += found
        if not widths:
            raise Fault("the frame has no `id` part; add `- id: u8`, or name a field of the header")
        return Comparison(Subject.ID, self._ranges(text, max(widths), {}, "the id"), mask=text.mask)

    def _of_magic(self, text: ComparisonText) -> Comparison:
        listed = [value for part in self._parts if part.kind == PartKind.MAGIC for value in magic_values(part)]
        if self._part.kind == PartKind.MAGIC or not listed:
            raise Fault("there is no magic that could decide this; name a field of the header")
        return Comparison(Subject.MAGIC, tuple(sorted(magic_ranges(text, listed))), size=len(listed[0]))

    def _of_sender(self, text: ComparisonText) -> Comparison:
        ranges = []
        for low, high in text.ranges:
            if low is not high or str(low) not in (End.HOST, End.MCU):
                raise Fault("the sender is `host` or `mcu`; write `sender == host`")
            ranges.append((SENDER_NUMBERS[End(str(low))],) * 2)
        return Comparison(Subject.SENDER, _merged(ranges))

    def _of_size(self, text: ComparisonText) -> Comparison:
        payload = self._parts[self._payload] if self._payload < len(self._parts) else None
        if payload is not None and payload.payload == PayloadRule.FIXED:
            raise Fault(f"every payload has {payload.fixed_payload} bytes in this frame; remove this condition")
        return Comparison(Subject.SIZE, self._ranges(text, 16, {}, "the payload's size"))

    def _stands_before(self, index: int, name: str) -> None:
        if index > min(self._index, self._payload) or index == self._index:
            raise Fault(f"`{name}` must be in the header, before the parts that depend on it; move it forward")

    def _ranges(
        self, text: ComparisonText, width: int, names: dict[str, int], what: str
    ) -> tuple[tuple[int, int], ...]:
        return ranges_of(text, width, names, what)


def magic_ranges(text: ComparisonText | MatchText, listed: list[bytes]) -> tuple[tuple[int, int], ...]:
    """Return the magics that the text names, of those of the frame, in their order. Raises ``Fault``."""
    ranges = []
    for low, high in text.ranges:
        if low is not high or low.is_name or not all(word.startswith("0x") for word in low.words):
            sign = " ==" if isinstance(text, ComparisonText) else ":"
            raise Fault(f"a magic is compared with bytes; write `magic{sign} {bytes_text(listed[0])}`")
        numbers = [int(word, 16) for word in low.words]
        if max(numbers) > 0xFF or bytes(numbers) not in listed:
            raise Fault("no magic of this frame has that value; take one of its list")
        ranges.append((int.from_bytes(bytes(numbers), "big"),) * 2)
    return tuple(dict.fromkeys(ranges))


def ranges_of(
    text: ComparisonText | MatchText, width: int, names: dict[str, int], what: str
) -> tuple[tuple[int, int], ...]:
    """Return the numbers of ``width`` bits that the text allows. Raises ``Fault``."""
    most = (1 << width) - 1
    if text.mask is not None and text.mask > most:
        raise Fault(f"{what} has {width} bits; take a lower one")
    ranges = []
    for low, high in text.ranges:
        start = _number(low, names, what)
        stop = most if str(high) == str(_MOST) else _number(high, names, what)
        for value, word in ((start, low), (stop, high)):
            if value > most:
                raise Fault(f"{what} has {width} bits, and {word} does not fit; the maximum is {most}")
            if text.mask is not None and low is high and value & ~text.mask:
                raise Fault(f"{word} has bits that 0x{text.mask:02X} does not select; this is never true")
        if start > stop:
            raise Fault(f"the range {low}..{high} is empty; write the smaller bound first")
        ranges.append((start, stop))
    return _merged(ranges)


def _number(value: ValueText, names: dict[str, int], what: str) -> int:
    if value.is_name:
        if str(value) in names:
            return names[str(value)]
        if names:
            raise Fault(f"{what} has no value `{value}`; {suggestion(str(value), names)}")
        raise Fault(f"{what} has no named values; write a number instead of `{value}`")
    if len(value.words) > 1:
        raise Fault(f"{what} is a number; write it as one, and not byte by byte: `{value}`")
    return value.number


def magic_values(part: Part) -> list[bytes]:
    return [value for _, value in part.by_sender] or list(part.alternatives or (part.value,))


def _is_magic(field: HeaderField, parts: list[Part]) -> bool:
    return any(part.kind == PartKind.MAGIC and part.header is field for part in parts)


def _merged(ranges: list[tuple[int, int]]) -> tuple[tuple[int, int], ...]:
    """Merge ranges: in rising order and apart."""
    found: list[tuple[int, int]] = []
    for low, high in sorted(ranges):
        if found and low <= found[-1][1] + 1:
            found[-1] = found[-1][0], max(found[-1][1], high)
        else:
            found.append((low, high))
    return tuple(found)
