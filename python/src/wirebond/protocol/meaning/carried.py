"""Checks that a form of the frame exists for each id and size of a message."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import ceil, floor

from wirebond.protocol.matching import ID_BITS, one_id
from wirebond.protocol.meaning.messages import spoken
from wirebond.protocol.model import End, Field, Match, MatchOf, Message, Part, Subject
from wirebond.protocol.model.forms import Choice, Intervals, complement, header_fields, some_value
from wirebond.protocol.plan import Form, HeaderNumber
from wirebond.protocol.planning import forms


def uncarried(parts: tuple[Part, ...], id_bits: int, message: Message) -> str:
    """Return why no form of the frame carries one of the ids or sizes of this message; empty if all are carried.

    ``id_bits``: of the frame's widest id. An id beyond it is refused elsewhere.
    """
    if message.has_id and message.id >> id_bits:
        return ""
    fields = {field.name: field.value for field in header_fields(parts)}
    for end in (End.HOST, End.MCU):
        if not message.sent_by(end):
            continue
        fitting = [form for form in forms(parts, end) if (form.id is not None) == message.has_id]
        own = [form for form in fitting if _can_be_sent(form, fields)]
        if not fitting:  # which is said elsewhere, too
            continue
        widest = max((form.id.mask for form in own if form.id is not None), default=0)
        if message.has_id and 0 < widest < message.id:
            return (
                f"`{message.name}` has the id {_number(message.id)}, and those of the {spoken(end)}'s frames go up to "
                f"{_number(widest)}; take a smaller one, or a wider `id` part"
            )
        for size in (message.min_payload, message.max_payload):
            allowed = [form for form in own if _allows(form, message, size)]
            if any(form.payload_rest == form.payload_unit for form in own) and not allowed:
                return (
                    f"the frame of `{message.name}` always ends a check's range within a word, which the check refuses "
                    "(`odd: refuse`); let it cover whole words, or write `odd: pad`"
                )
            units = {form.payload_unit for form in own if size % form.payload_unit != form.payload_rest}
            if not allowed and len(units) == 1:
                return (
                    f"with {size} payload bytes `{message.name}` ends within a word of {units.pop()} bytes, which the "
                    "check refuses (`odd: refuse`); add a field `{type: padding, size: 1}`, or write `odd: pad`"
                )
            found = _uncarried_id(allowed, message, id_bits)
            if found is None:
                continue
            named = f" and the id {_number(found)}" if message.ids is not None else ""
            return (
                f"no frame of the {spoken(end)} carries `{message.name}` with {size} payload bytes{named}; let the "
                "conditions of the frame (`when`) leave a form for it"
            )
    return ""


def _number(value: int) -> str:
    return f"{value} (0x{value:02X})"


def _allows(form: Form, message: Message, size: int) -> bool:
    """Check whether such a frame can carry the message, apart from its id."""
    if size > form.most_payload or size % form.payload_unit != form.payload_rest:
        return False
    sizes = [held.choice for held in form.choices if held.choice.subject == Subject.SIZE]
    matched = [match for match in message.match if match.of == MatchOf.HEADER]
    return all(choice.holds(size) for choice in sizes) and all(_has(form, match) for match in matched)


def _can_be_sent(form: Form, fields: Mapping[str, Field]) -> bool:
    """Check whether each header field has a value that its own rules and this form allow. A sender refuses any
    other."""
    for held in form.header:
        field = fields[held.name]
        allowed = _allowed(field)
        if allowed:
            whole = Choice(Subject.FIELD, held.name, (1 << field.width) - 1, allowed)
            if some_value((whole, *_asked(form, held)), field.width) is None:
                return False
    return True


def _allowed(field: Field) -> Intervals:
    """Return the bits of the values that a header field may have; empty: any, as far as is easily known."""
    if field.enum:
        return tuple((bits, bits) for bits in sorted({field.wire_bits(name) for name, _ in field.enum}))
    if not field.is_unsigned or field.is_scaled or field.minimum is None or field.maximum is None:
        return ()
    return ((ceil(field.minimum), floor(field.maximum)),)


def _has(form: Form, match: Match) -> bool:
    """Check whether a header field of this form can have a value that identifies the message."""
    field = next((field for field in form.header if field.name == match.name), None)
    return field is not None and some_value((_choice(match), *_asked(form, field)), match.width) is not None


def _asked(form: Form, field: HeaderNumber) -> list[Choice]:
    """Return the form's conditions on this field."""
    fixed = Choice(Subject.FIELD, field.name, field.fixed_mask, ((field.fixed_value, field.fixed_value),))
    return [fixed, *(held.choice for held in form.choices if held.choice.number == fixed.number)]


def _uncarried_id(allowed: list[Form], message: Message, id_bits: int) -> int | None:
    """Return an id of the message that none of these forms carries; None if there is no such id."""
    if not message.has_id:
        return None if allowed else 0
    asked = [_id_choices(form) for form in allowed]
    return _breaking(asked, (_room(id_bits), _choice(message.ids or one_id(message.id))))


def _id_choices(form: Form) -> list[Choice]:
    assert form.id is not None, "a message with an id is carried by forms that have one"
    room = _room(form.id.mask.bit_length())
    return [room, *(held.choice for held in form.choices if held.choice.subject == Subject.ID)]


def _room(bits: int) -> Choice:
    """Return an id that has no more bits."""
    return Choice(Subject.ID, "", (1 << ID_BITS) - 1, ((0, (1 << bits) - 1),))


def _breaking(asked: list[list[Choice]], so_far: tuple[Choice, ...]) -> int | None:
    """Return an id with which all of ``so_far`` hold, and of each form one choice does not."""
    found = some_value(so_far, ID_BITS)
    if found is None or not asked:
        return found
    for choice in asked[0]:
        others = complement(choice.allowed, choice.mask)
        if not others:
            continue
        broken = _breaking(asked[1:], (*so_far, replace(choice, allowed=others)))
        if broken is not None:
            return broken
    return None


def _choice(match: Match) -> Choice:
    return Choice(Subject.FIELD, match.name, match.mask, tuple(sorted(match.ranges)))
