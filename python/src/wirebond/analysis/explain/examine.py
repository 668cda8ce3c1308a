"""One candidate against its format's rules, in the order in which the decoder applies them. No stream, no sentences.

Written from the model's parts alone, without the engine's plan of offsets: tests let both examine the same bytes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

from wirebond.analysis.explain.constants import constants_of
from wirebond.analysis.explain.counted import bound_by_counts
from wirebond.analysis.explain.layout import (
    CONSTANTS,
    check_value,
    counted_beside_payload,
    covered_bytes,
    fixed_bits,
    found_check,
    hex_of,
    id_text,
    length_index,
    read_number,
    run_value,
    same_check,
    shift_of,
    shown_check,
    spans,
)
from wirebond.analysis.explain.numbers import raw_number
from wirebond.analysis.explain.shapes import Heard, Shape, shapes_of
from wirebond.analysis.explain.sharing import found_text, sharing, wanted_text
from wirebond.analysis.explain.verdict import Cause, Outcome, Question, Rule, Verdict
from wirebond.protocol.matching import Told
from wirebond.protocol.model import (
    BitRole,
    End,
    Message,
    Part,
    PartKind,
    PayloadRule,
    Protocol,
    Subject,
)
from wirebond.protocol.model.forms import header_of
from wirebond.protocol.model.layout import Bits, Characters, Group, List, Step
from wirebond.protocol.planning import told_by_request
from wirebond.protocol.spelling import choices_text


@lru_cache(maxsize=256)
def _meant(key: Heard[tuple[Message, ...]]) -> list[Message]:
    """Return the candidates among messages that share an id. Those that only a request identifies are excluded, because
    no request is known here."""
    dependent = told_by_request(key.of, key.sender)
    return [m for m in key.of if m.sent_by(key.sender) and m.name not in dependent]


def examine(protocol: Protocol, data: bytes, sender: End | None, *, block: bytes | None = None) -> Verdict:
    """Return the verdict on the candidate that begins with ``data``. ``block``: where its size is known to be
    ``len(data)``, what it was before unstuffing.

    Of several forms the first that holds; else the refusal of the one that got furthest. Pure; work is one pass over
    at most one frame for each form.
    """
    best: Verdict | None = None
    for shape in shapes_of(protocol, sender):
        found = _Examination(protocol, shape, data, sender, block).run()
        if found.is_frame:
            return found
        if best is None or _is_nearer(found, best):
            best = found
    assert best is not None, "every format has a form"
    return best


# Causes in the order in which they are decided: of two forms that go as far, the one that was examined further counts.
_IN_ORDER = {cause: place for place, cause in enumerate(Cause)}


def _is_nearer(found: Verdict, best: Verdict) -> bool:
    waits, best_waits = found.outcome == Outcome.INCOMPLETE, best.outcome == Outcome.INCOMPLETE
    if waits:
        return not best_waits or found.extent < best.extent
    return not best_waits and (found.extent, _IN_ORDER[found.cause]) > (best.extent, _IN_ORDER[best.cause])


class _Decided(Exception):  # noqa: N818  (an outcome, not an error)
    def __init__(self, outcome: Outcome, cause: Cause, size: int) -> None:
        self.outcome, self.cause, self.size = outcome, cause, size


@dataclass
class _Examination:
    protocol: Protocol
    shape: Shape
    data: bytes
    sender: End | None
    block: bytes | None
    rules: list[Rule] = field(default_factory=list)
    id: int | None = None
    message: Message | None = None
    told: Told | None = None  # identifies its message
    payload: tuple[int, int] | None = None
    parts: tuple[Part, ...] = field(init=False)

    def __post_init__(self) -> None:
        self.parts = self.shape.form.parts

    def run(self) -> Verdict:
        try:
            decided = _Decided(Outcome.FRAME, Cause.NONE, self._go_through())
        except _Decided as outcome:
            decided = outcome
        return Verdict(
            decided.outcome,
            decided.cause,
            decided.size,
            self.parts,
            tuple(self.rules),
            self.id,
            self.message,
            self.payload,
        )

    def _go_through(self) -> int:
        """Return the frame's size, or _Decided."""
        parts, shape = self.parts, self.shape
        at, before, prefix, early_id = shape.payload_at, shape.before, shape.prefix, shape.tells_id_early
        self._constants_and_choices(before)
        self._need(prefix)
        if early_id:
            self._read_id(before, 0)
        size = self._payload_size(prefix)
        if early_id and parts[at].payload != PayloadRule.BY_ID:
            self._read_id(before, size)
        self.payload = prefix, prefix + size
        knows_size = early_id or (shape.id_at is None and not shape.tells_late) or not parts[at].trims_zeros
        if knows_size:
            self._size_choices(size, prefix)
        if early_id and (self.block is not None or not self.protocol.format.length_on_wire):
            self._message_fits(size, prefix)
        for index in shape.header_checks:
            self._check(index, before, Cause.HEADER_CHECK_MISMATCH, prefix)

        places = spans(parts, size)
        total = places[-1][1]
        self._whole_frame(total)
        for index in range(at + 1, len(parts)):
            self._constant(index, places[index][0], extent=total)
        if not early_id:
            self._read_id(places, size, self.data[prefix : prefix + size])
            if not knows_size:
                self._size_choices(size, total)
            self._message_fits(size, total)
        self._counts_allow(prefix, size, total)
        self._field_constants(prefix, size, total)
        for index in shape.checks:
            self._check(index, places, Cause.CHECK_MISMATCH, total)
        return total

    def _rule(
        self, question: Question, part: int | None, holds: bool, expected: str, found: str, cause: Cause, extent: int
    ) -> None:
        self.rules.append(Rule(question, part, holds, expected, found))
        if not holds:
            raise _Decided(Outcome.REFUSED, cause, extent)

    def _need(self, size: int) -> None:
        if len(self.data) < size:
            raise self._missing(size)

    def _missing(self, size: int) -> _Decided:
        have = len(self.data)
        self.rules.append(Rule(Question.SIZE, None, False, f"at least {size} bytes", f"{have} bytes"))
        if self.block is not None:
            return _Decided(Outcome.REFUSED, Cause.LENGTH_OUT_OF_RANGE, have)
        return _Decided(Outcome.INCOMPLETE, Cause.INCOMPLETE, size)

    def _constants_and_choices(self, before: list[tuple[int, int]]) -> None:
        """Check a choice as soon as its number is known, even if a constant after it is not."""
        missing: _Decided | None = None
        try:
            for index, (start, _) in enumerate(before):
                self._constant(index, start, extent=1)
        except _Decided as decided:
            if decided.cause == Cause.CONSTANT_MISMATCH:
                raise
            missing = decided
        for choice in self.shape.form.choices:
            if choice.subject == Subject.SIZE or choice.fixed_bits is not None:
                continue
            index = next(i for i, part in enumerate(self.parts) if shift_of(part, choice) is not None)
            start, stop = before[index]
            if stop > len(self.data):
                if missing is None or stop < missing.size:
                    missing = self._missing(stop)
                continue
            part = self.parts[index]
            run = next((run for run in part.bits if run.shift == shift_of(part, choice)), None)
            number = read_number(part, self.data[start:stop])
            value = number if run is None else number >> run.shift & run.mask
            expected = choices_text((choice,))
            self._rule(Question.CONDITION, index, choice.holds(value), expected, str(value), Cause.CONSTANT_MISMATCH, 1)
        if missing is not None:
            raise missing

    def _size_choices(self, size: int, extent: int) -> None:
        """Apply conditions on the payload's size. If the frame's end is found otherwise, they only choose the sent
        form."""
        payload = self.parts[self.shape.payload_at]
        if payload.payload == PayloadRule.REST:
            return
        if payload.trims_zeros and self.message is not None:
            size = max(size, self.message.min_payload)
        for choice in self.shape.form.choices:
            if choice.subject == Subject.SIZE:
                expected, found = choices_text((choice,)), str(size)
                holds = choice.holds(size)
                self._rule(Question.CONDITION, None, holds, expected, found, Cause.LENGTH_OUT_OF_RANGE, extent)

    def _constant(self, index: int, start: int, extent: int) -> None:
        """Check bytes or bits that cannot vary, each as soon as its byte has come."""
        constant = self.shape.constants[index]
        if constant is None:
            return
        part = self.parts[index]
        wanted, masks = constant
        found = self.data[start : start + part.size]
        for place, (byte, bits) in enumerate(zip(wanted, masks, strict=True)):
            if bits and place >= len(found):
                self._need(start + place + 1)
            if bits and found[place] & bits != byte:
                expected, got = self._constant_texts(part, found)
                self._rule(Question.CONSTANT, index, False, expected, got, Cause.CONSTANT_MISMATCH, extent)
        expected, got = self._constant_texts(part, found)
        self.rules.append(Rule(Question.CONSTANT, index, True, expected, got))

    def _constant_texts(self, part: Part, found: bytes) -> tuple[str, str]:
        if part.kind in CONSTANTS:
            return hex_of(part.value), hex_of(found)
        mask, value = fixed_bits(part, self.shape.form.choices)
        digits = 2 * part.size
        number = read_number(part, found)
        return f"0x{value:0{digits}X} in the bits 0x{mask:0{digits}X}", f"0x{number & mask:0{digits}X}"

    def _read_id(self, places: list[tuple[int, int]], size: int, payload: bytes = b"") -> None:
        """Read the id, and find the message by it and by other conditions. ``size`` and ``payload``: as far as they are
        known."""
        index = self.shape.id_at
        self.id = 0
        if index is not None:
            part = self.parts[index]
            start, stop = places[index]
            self.id = run_value(part, read_number(part, self.data[start:stop]), BitRole.ID)
        told = Told(
            self.id if index is not None else None,
            self._header_numbers(places),
            size,
            payload,
            self.parts[self.shape.payload_at].trims_zeros,
        )
        meant = _meant(Heard(self.protocol.messages, self.sender))
        self.told = told
        self.message = next((m for m in meant if told.is_of(m)), None)

    def _header_numbers(self, places: list[tuple[int, int]]) -> dict[str, int]:
        """Return the header fields of the received parts, as bits."""
        found: dict[str, int] = {}
        for part, (start, stop) in zip(self.parts, places, strict=False):
            if stop > len(self.data) or not header_of(part):
                continue
            data = self.data[start:stop]
            number = int.from_bytes(data, "big") if part.kind == PartKind.MAGIC else read_number(part, data)
            found |= {} if part.header is None else {part.header.name: number}
            found |= {run.header.name: number >> run.shift & run.mask for run in part.bits if run.header is not None}
        return found

    def _payload_size(self, prefix: int) -> int:
        parts = self.parts
        payload = parts[self.shape.payload_at]
        most = self.protocol.format.max_payload_from(self.sender)
        outside = self.shape.outside
        have = len(self.data)
        if payload.payload == PayloadRule.FIXED:
            return payload.fixed_payload
        if payload.payload == PayloadRule.REST:
            size, expected = have - outside, f"{outside} to {outside + most} bytes"
            self._rule(
                Question.SIZE, None, 0 <= size <= most, expected, f"{have} bytes", Cause.LENGTH_OUT_OF_RANGE, have
            )
            return size
        if payload.payload == PayloadRule.BY_ID:
            self._known_message(prefix)
            assert self.message is not None
            return self._counted_size(self.message, prefix)
        index = length_index(parts)
        if index is None:  # other forms have the length; this one carries nothing
            return 0
        part = parts[index]
        start, stop = spans(parts, 0)[index]
        number = run_value(part, read_number(part, self.data[start:stop]), BitRole.LENGTH)
        beside = counted_beside_payload(parts, index)
        size = number * part.length_unit - beside
        expected = f"{max(0, beside)} to {(most + beside) // part.length_unit}"
        if self.protocol.format.length_on_wire:  # it counts the bytes that stuffing adds, too
            longest = max(shape.outside for shape in shapes_of(self.protocol, self.sender))
            most += self.protocol.format.overhead(most + longest)
        holds = 0 <= size <= most
        self._rule(Question.LENGTH, index, holds, expected, str(number), Cause.LENGTH_OUT_OF_RANGE, prefix)
        if self.protocol.format.length_on_wire and self.block is not None:  # known now that nothing is stuffed any more
            size, most = have - outside, self.protocol.format.max_payload_from(self.sender)
            expected, found = f"{outside} to {outside + most} bytes", f"{have} bytes"
            self._rule(Question.SIZE, None, 0 <= size <= most, expected, found, Cause.LENGTH_OUT_OF_RANGE, have)
        return size

    def _counted_size(self, message: Message, prefix: int) -> int:
        """Return the message's own size, or the one that its counts give."""
        if message.min_payload == message.max_payload:
            return message.max_payload
        return self._end_of(message.layout, prefix, prefix) - prefix

    def _end_of(self, steps: tuple[Step, ...], at: int, prefix: int) -> int:
        places: dict[str, tuple[int, Step]] = {}
        for step in steps:
            one = step.field
            if isinstance(step, List | Characters) and step.told:
                at += self._counted_bytes(step, places, prefix)
            elif isinstance(step, Group):
                for _ in range(one.count or 1):
                    at = self._end_of(step.steps, at, prefix)
            else:
                places[one.name] = at, step
                at += one.min_wire_bytes
        return at

    def _counted_bytes(self, step: List | Characters, places: dict[str, tuple[int, Step]], prefix: int) -> int:
        """Return the size of a list's elements: by its first count, if another one agrees."""
        one = step.field
        size, room = (step.stride, one.max_count) if isinstance(step, List) else (1, one.max_size)
        amount: int | None = None
        for told in step.told:
            number = self._count(told.name, places)
            most = room * told.per
            expected = f"{told.name} at most {most}"
            if number <= most and number % told.per:
                expected = f"{told.name} a multiple of {told.per}"
            elif number <= most and amount is not None:
                expected = f"{told.name} {amount * told.per}"
            holds = number <= most and number % told.per == 0 and amount in (None, number // told.per)
            where = self.shape.payload_at
            self._rule(Question.LENGTH, where, holds, expected, str(number), Cause.LENGTH_OUT_OF_RANGE, prefix)
            amount = number // told.per
        return size * (amount or 0)

    def _count(self, name: str, places: dict[str, tuple[int, Step]]) -> int:
        outer, _, run = name.partition(".")
        place, counting = places[outer]
        size = counting.field.size
        self._need(place + size)
        number = raw_number(counting.field, self.data[place : place + size])
        for member in counting.members if isinstance(counting, Bits) else ():
            if member.field.name == run:
                return member.bits_of(number)
        return number

    def _known_message(self, extent: int) -> None:
        index = self.shape.id_at
        found = id_text(self.parts, self.id or 0) if index is not None else "no id"
        expected = "the id of a known message" if index is not None else "a message without an id"
        near = [] if self.message is not None or self.told is None else self._sharing()
        if near and self.told is not None:
            if index is not None:
                self.rules.append(Rule(Question.MESSAGE, index, True, expected, found))
            wanted = wanted_text(near)
            self._rule(Question.MATCH, index, False, wanted, found_text(near, self.told), Cause.UNKNOWN_MESSAGE, extent)
        self._rule(Question.MESSAGE, index, self.message is not None, expected, found, Cause.UNKNOWN_MESSAGE, extent)

    def _sharing(self) -> list[Message]:
        return sharing(self.protocol, self.sender, self.id if self.shape.id_at is not None else None)

    def _message_fits(self, size: int, extent: int) -> None:
        frame_format = self.protocol.format
        if frame_format.deliver_unknown:
            return
        payload = self.parts[self.shape.payload_at]
        if payload.payload != PayloadRule.BY_ID:  # there it was asked before, to know the payload's size
            self._known_message(extent)
        message = self.message
        assert message is not None
        if payload.payload in (PayloadRule.BY_LENGTH, PayloadRule.REST):
            least = 0 if payload.trims_zeros else message.min_payload
            fits = least <= size <= message.max_payload
            most = f" to {message.max_payload}" if message.max_payload != least else ""
            expected = f"{least}{most} payload bytes for {message.name}"
            self._rule(Question.MESSAGE, self.shape.id_at, fits, expected, str(size), Cause.UNKNOWN_MESSAGE, extent)

    def _counts_allow(self, start: int, size: int, extent: int) -> None:
        """Refuse a payload that is longer than its counts say, if unknown sizes are refused."""
        if self.protocol.format.deliver_unknown or self.message is None:
            return
        if self.parts[self.shape.payload_at].payload not in (PayloadRule.BY_LENGTH, PayloadRule.REST):
            return
        bound = bound_by_counts(self.message, self.data[start : start + size])
        if bound is not None:
            expected = f"{bound.text} for {self.message.name}"
            holds = size <= bound.most
            self._rule(Question.MESSAGE, self.shape.id_at, holds, expected, str(size), Cause.UNKNOWN_MESSAGE, extent)

    def _field_constants(self, start: int, size: int, extent: int) -> None:
        """Check the constants of a message whose payload is long enough; a shorter one is of an unknown message."""
        message = self.message
        trims = self.parts[self.shape.payload_at].trims_zeros
        if message is None or (size < message.min_payload and not trims):
            return
        payload = self.data[start : start + size]
        for found in constants_of(message, payload.ljust(message.min_payload, b"\0") if trims else payload):
            where = self.shape.payload_at
            expected, text = f"{found.path} {found.expected}", found.text
            self._rule(Question.FIELD, where, found.holds, expected, text, Cause.CONSTANT_MISMATCH, extent)

    def _whole_frame(self, total: int) -> None:
        have = len(self.data)
        if self.block is not None:
            expected, found = f"{total} bytes", f"{have} bytes"
            self._rule(Question.SIZE, None, have == total, expected, found, Cause.LENGTH_OUT_OF_RANGE, have)
        else:
            self._need(total)

    def _check(self, index: int, places: list[tuple[int, int]], cause: Cause, extent: int) -> None:
        part = self.parts[index]
        seed = self.message.seed or 0 if self.message is not None else 0
        covered = covered_bytes(self.parts, index, self.data, places)
        if part.on_wire and self.block is not None:
            covered = self._on_wire(part, places, self.block)
        expected = check_value(part, covered, seed)
        found = found_check(self.parts, index, self.data, places)
        shown = shown_check(part, expected), shown_check(part, found)
        self._rule(Question.CHECK, index, same_check(part, expected, found), *shown, cause, extent)

    def _on_wire(self, part: Part, places: list[tuple[int, int]], block: bytes) -> bytes:
        """Return the bytes that a check covers before unstuffing. After the stuffed parts, distances from the block's
        end and from the frame's end are equal."""
        grown = len(block) - len(self.data)
        behind = max(index for index, other in enumerate(self.parts) if not other.is_plain) + 1
        edges = [start for start, _ in places] + [len(self.data)]
        sent = [edge + grown if index >= behind else edge for index, edge in enumerate(edges)]
        return b"".join(block[sent[first] : sent[last + 1]] for first, last in part.ranges)
