"""One form of a frame, to offsets from its first byte and its last."""

from __future__ import annotations

from dataclasses import replace

from wirebond.protocol.model import (
    Algorithm,
    BitRole,
    ByteOrder,
    End,
    HeaderField,
    LengthCounts,
    OddTail,
    Part,
    PartKind,
    PayloadRule,
    Subject,
)
from wirebond.protocol.model.forms import Choice, FormParts, complement
from wirebond.protocol.plan import (
    CheckRule,
    Constant,
    Exclusion,
    Form,
    FormChoice,
    HeaderNumber,
    Number,
    Position,
)
from wirebond.protocol.registers import register_of

_CONSTANT_KINDS = (PartKind.MAGIC, PartKind.CONSTANT, PartKind.TAIL)
_WITHOUT_NUMBER = (PartKind.PAYLOAD, PartKind.RESERVED, PartKind.BITS)  # whose bits are looked at one by one, if any


def offsets_of(form_parts: FormParts, algorithms: list[Algorithm], places: dict[str, int], sender: End | None) -> Form:
    parts = form_parts.parts
    payload_index = next(i for i, p in enumerate(parts) if p.kind == PartKind.PAYLOAD)
    payload = parts[payload_index]
    prefix = sum(p.size for p in parts[:payload_index])
    suffix = sum(p.size for p in parts[payload_index + 1 :])

    def start_of(index: int) -> Position:
        if index <= payload_index:
            return Position(sum(p.size for p in parts[:index]))
        return Position(-sum(p.size for p in parts[index:]), from_end=True)

    def end_of(index: int) -> Position:
        if index < payload_index:
            return Position(sum(p.size for p in parts[: index + 1]))
        return Position(-sum(p.size for p in parts[index + 1 :]), from_end=True)

    before: list[Constant] = []
    after: list[Constant] = []
    length: Number | None = None
    length_bias, length_unit = 0, 1
    message_id: Number | None = None
    header: list[HeaderNumber] = []

    def held(field: HeaderField, number: Number) -> HeaderNumber:
        mask = value = 0
        for choice in form_parts.choices:
            if choice.number == (Subject.FIELD, field.name) and (fixed := choice.fixed_bits) is not None:
                mask, value = mask | fixed[0], value | fixed[1]
        return HeaderNumber(field.name, number, field.default_bits(sender), places[field.name], mask, value)

    checks: list[tuple[bool, int, Part]] = []
    for index, part in enumerate(parts):
        at = start_of(index)
        place = before if index < payload_index else after
        if part.kind in _CONSTANT_KINDS:
            place.extend(Constant(Position(at.offset + i, at.from_end), byte) for i, byte in enumerate(part.value))
            if part.header is not None:
                mask, magic = (1 << 8 * part.size) - 1, int.from_bytes(part.value, "big")
                number = Number(at, part.size, ByteOrder.BIG, 0, mask)
                place_of = places[part.header.name]
                header.append(HeaderNumber(part.header.name, number, magic, place_of, mask, magic, is_magic=True))
        elif part.kind == PartKind.LENGTH:
            length = _whole(at, part)
        elif part.kind == PartKind.ID:
            message_id = _whole(at, part)
            if part.header is not None:
                header.append(held(part.header, message_id))
        elif part.header is not None:
            header.append(held(part.header, _whole(at, part)))
        elif part.kind == PartKind.CHECK:
            in_header = index < payload_index and part.last_covered < payload_index
            checks.append((not in_header, index, part))
        elif part.kind not in _WITHOUT_NUMBER:
            raise NotImplementedError(f"offsets.py has no entry for the part '{part.kind}'")
        for run in part.bits:
            number = Number(at, part.size, part.order, run.shift, run.mask)
            if run.role == BitRole.LENGTH:
                length = number
            elif run.role == BitRole.ID:
                message_id = number
                header += [] if run.header is None else [held(run.header, number)]
            elif run.role == BitRole.CONSTANT:
                place.extend(_bits_constant(number, run.value))
            elif run.header is not None:
                header.append(held(run.header, number))
        if part.kind == PartKind.LENGTH or any(run.role == BitRole.LENGTH for run in part.bits):
            length_bias, length_unit = _length_rule(parts, index, prefix, suffix), part.length_unit
    choices: list[FormChoice] = []
    exclusions: list[Exclusion] = []
    id_mask = id_value = 0
    for choice in form_parts.choices:
        found = _number_of(choice, header, message_id)
        choices.append(FormChoice(choice, found))
        fixed = None if found is None else choice.fixed_bits
        if found is not None and fixed is not None:
            before.extend(_bits_constant(replace(found, mask=fixed[0]), fixed[1]))
            if choice.subject == Subject.ID:
                id_mask, id_value = id_mask | fixed[0], id_value | fixed[1]
            continue
        on_receive = found is not None or payload.payload != PayloadRule.REST
        exclusions += [
            Exclusion(choice.subject, places.get(choice.name, 0), found, low, high, on_receive)
            for low, high in complement(choice.allowed, choice.mask)
        ]
    before.sort(key=lambda constant: constant.at.offset)
    checks.sort(key=lambda entry: entry[:2])

    rules: list[CheckRule] = []
    for _, index, part in checks:
        assert part.algorithm is not None
        register, shift = register_of(part.algorithm)
        algorithm = algorithms.index(register)
        ranges = tuple((start_of(first), end_of(last)) for first, last in part.ranges)
        start, stop = ranges[0]
        continues = -1
        for earlier_index, earlier in enumerate(rules):
            (begin, end), *more = earlier.ranges
            is_plain = not more and not earlier.covers_run and not part.on_wire
            same = earlier.algorithm == algorithm and begin == start and is_plain
            # Both ends count from the start, or this one is after the payload: the earlier range is inside.
            inside = not end.from_end and (stop.from_end or end.offset <= stop.offset)
            if same and inside:
                continues = earlier_index
        size = part.size // 2 if part.as_hex else part.size
        at = start_of(index)
        own: Number | None = None
        if part.in_bits is not None:
            holder = parts[index - 1]
            at = start_of(index - 1)
            own = Number(at, holder.size, holder.order, part.in_bits.shift, part.in_bits.mask)
        rules.append(
            CheckRule(
                algorithm,
                ranges,
                at,
                size,
                part.order,
                part.shift + shift,
                part.seeded,
                part.as_hex,
                part.on_wire,
                continues,
                own,
                own is not None and index - 1 in part.covered,
            )
        )
    payload_unit, payload_rest = _refused_sizes(parts, payload_index, [part for _, _, part in checks])
    return Form(
        prefix=prefix,
        suffix=suffix,
        payload=payload.payload,
        fixed_payload=payload.fixed_payload,
        trims_zeros=payload.trims_zeros,
        length=length,
        length_unit=length_unit,
        length_bias=length_bias,
        id=message_id,
        constants=tuple(before + after),
        prefix_constants=len(before),
        checks=tuple(rules),
        header_checks=sum(1 for late, _, _ in checks if not late),
        header=tuple(header),
        choices=tuple(choices),
        exclusions=tuple(exclusions),
        payload_unit=payload_unit,
        payload_rest=payload_rest,
        id_mask=id_mask,
        id_value=id_value,
    )


def _refused_sizes(parts: tuple[Part, ...], payload_index: int, checks: list[Part]) -> tuple[int, int]:
    """Return the payload sizes that checks over whole words accept: a divisor of the size, and the remainder.

    A rest as great as the divisor lets none pass.
    """
    payload = parts[payload_index]
    varies = payload.payload != PayloadRule.FIXED or payload.trims_zeros
    found = [(1, 0)]
    for check in checks:
        if check.algorithm is None or check.algorithm.odd != OddTail.REFUSE:
            continue
        unit = check.algorithm.unit
        has_payload = payload_index in check.covered
        beside = sum(parts[index].size for index in check.covered) + check.seeded
        if has_payload and varies:
            found.append((unit, -beside % unit))
        elif (beside + payload.fixed_payload * has_payload) % unit:
            found.append((unit, unit))
    most, most_rest = max(found)
    agree = all(rest == most_rest % unit for unit, rest in found)
    return most, most_rest if agree else most


def _number_of(choice: Choice, header: list[HeaderNumber], message_id: Number | None) -> Number | None:
    """Return the place of a choice's bits, or None if it is about the payload's size."""
    if choice.subject == Subject.SIZE:
        return None
    if choice.subject == Subject.ID:
        assert message_id is not None, "a choice is about what is there"
        return replace(message_id, mask=choice.mask)
    return replace(next(f for f in header if f.name == choice.name).number, mask=choice.mask)


def _whole(at: Position, part: Part) -> Number:
    return Number(at, part.size, part.order, 0, (1 << 8 * part.size) - 1)


def _length_rule(parts: tuple[Part, ...], index: int, prefix: int, suffix: int) -> int:
    """Return the bias: payload bytes = length number * unit + bias."""
    part = parts[index]
    follows = sum(p.size for p in parts[index + 1 :])
    beside_payload = {
        LengthCounts.PAYLOAD: 0,
        LengthCounts.REST: follows,
        LengthCounts.SELF_AND_REST: part.size + follows,
        LengthCounts.FRAME: prefix + suffix,
    }[part.counts]
    return -beside_payload - part.length_offset


def _bits_constant(number: Number, value: int) -> list[Constant]:
    """Return the bytes of ``number`` that ``mask`` touches, as masked constants."""
    mask, bits = number.mask << number.shift, value << number.shift
    constants = []
    for i in range(number.bytes):
        place = 8 * (i if number.order == ByteOrder.LITTLE else number.bytes - 1 - i)
        byte_mask = mask >> place & 0xFF
        if byte_mask:
            at = Position(number.at.offset + i, number.at.from_end)
            constants.append(Constant(at, bits >> place & byte_mask, byte_mask))
    return constants
