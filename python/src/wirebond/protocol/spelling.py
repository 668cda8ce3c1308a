"""The way back from the model to the words of a protocol file, for tools that show what to write there.

Only what differs from the format's defaults is written.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction

from wirebond.protocol import algorithms
from wirebond.protocol.model import (
    SENDER_NUMBERS,
    Algorithm,
    BitRole,
    Bits,
    ByteOrder,
    CheckKind,
    Comparison,
    Condition,
    Digits,
    Field,
    FieldKind,
    HeaderField,
    LengthCounts,
    Match,
    MatchOf,
    Message,
    Part,
    PartKind,
    PayloadRule,
    Subject,
)
from wirebond.protocol.model.forms import Choice


def bytes_text(data: bytes) -> str:
    """Write bytes as magics are written: ``0xAA 0x55``."""
    return " ".join(f"0x{byte:02X}" for byte in data)


def number_type(letter: str, size: int, order: ByteOrder) -> str:
    """Write a number's type: ``u8``, ``u16``, ``u16be``. Little-endian is a file's default."""
    return f"{letter}{8 * size}" + ("be" if size > 1 and order == ByteOrder.BIG else "")


def how_counted(field: Field) -> str:
    """Describe how the number of elements or bytes of a field is given; empty if no field gives it."""
    unit = "as many bytes as" if field.counted_in_bytes else "as many as"
    told = [f"{unit} {field.counted_by} says"] if field.counted_by else []
    told += [f"as many bytes as {field.bytes_counted_by} says"] if field.bytes_counted_by else []
    return ", and ".join(told)


def field_type(field: Field) -> str:
    """Write the type after ``type:``: ``i16``, ``u11``, ``f32``, ``text``; of a struct the name of its type. A number
    in characters has its notation, too: ``i32 in decimal digits``."""
    if field.kind == FieldKind.STRUCT:
        return field.type_name or "struct"
    if field.kind == FieldKind.BITS:
        return f"bits of {number_type('u', field.size, field.order)}"
    if not field.is_number:
        return field.kind.value
    letter = "f" if field.is_float else field.coding.letters
    if field.digits is not None:
        return f"{letter}{field.bits} in {_digits_text(field.digits)}"
    return f"{letter}{field.bits}" if field.bits else number_type(letter, field.size, field.order)


def _digits_text(digits: Digits) -> str:
    if digits.base == 16:
        return "hex digits"
    return f"decimal digits, {digits.decimals} after the point" if digits.decimals else "decimal digits"


def repeated_type(field: Field) -> str:
    """Write its type, and how often it occurs: ``3 of i16``, ``up to 16 of point, as many as number says``."""
    word = field_type(field) if field.constant is None else "constant"
    if field.packed is not None:
        word += f", packed from the {field.packed.value}est bit"
    if field.count is not None:
        return f"{field.count} of {word}"
    if field.is_list:
        return f"up to {field.max_count} of {word}, {_how_many(field)}"
    return f"{word}, {_how_many(field)}" if field.is_characters and field.size == 0 else word


def _how_many(field: Field) -> str:
    if field.ends_with is not None:
        return f"up to {field.max_size} bytes, followed by 0x{field.ends_with:02X}"
    asked = f"; {field.asked_by} of the request says how many" if field.asked_by else ""
    return (how_counted(field) or "to the payload's end") + asked


def ranges_text(parts: tuple[Part, ...], ranges: tuple[tuple[int, int], ...]) -> str:
    """Write ranges as after ``over:``: ``id..payload``, ``payload`` alone or ``[id..length, payload]``."""
    # A check among shared bits is meant with the part that has them.
    ends = [(parts[first].name, parts[last - (parts[last].in_bits is not None)].name) for first, last in ranges]
    texts = [first if first == last else f"{first}..{last}" for first, last in ends]
    return texts[0] if len(texts) == 1 else f"[{', '.join(texts)}]"


def condition_text(condition: Condition) -> str:
    """Return ``flags & 0x01`` or ``magic == 0xFD``, as it is written under ``when:``."""
    if condition.negated and len(condition.terms) == 1 and isinstance(condition.terms[0], Comparison):
        return _comparison_text(condition.terms[0], negated=True)
    terms = condition.terms
    text = " and ".join(_comparison_text(t) if isinstance(t, Comparison) else condition_text(t) for t in terms)
    return f"not ({text})" if condition.negated else text


def choices_text(choices: tuple[Choice, ...]) -> str:
    """Return the conditions of a form: ``flags & 0x01 and size in 256..65535``; empty for the only form."""
    return " and ".join(_choice_text(choice) for choice in choices)


def _choice_text(choice: Choice) -> str:
    mask = None if choice.mask != 1 and choice.mask & (choice.mask + 1) == 0 else choice.mask
    comparison = Comparison(choice.subject, choice.allowed, choice.name, mask)
    if choice.mask == 1 and choice.allowed == ((0, 0),):
        return _comparison_text(replace(comparison, ranges=((1, 1),)), negated=True)
    return _comparison_text(comparison)


def _comparison_text(comparison: Comparison, *, negated: bool = False) -> str:
    name = comparison.name or comparison.subject.value
    ranges = comparison.ranges
    if comparison.mask is not None:
        name = f"{name} & 0x{comparison.mask:02X}"
        if ranges == ((comparison.mask, comparison.mask),):
            return f"not ({name})" if negated else name
    if len(ranges) == 1 and ranges[0][0] == ranges[0][1]:
        return f"{name} {'!=' if negated else '=='} {_value_text(comparison, ranges[0][0])}"
    listed = [
        _value_text(comparison, low)
        if low == high
        else f"{_value_text(comparison, low)}..{_value_text(comparison, high)}"
        for low, high in ranges
    ]
    text = listed[0] if len(listed) == 1 else f"[{', '.join(listed)}]"
    return f"{name} {'not in' if negated else 'in'} {text}"


def _value_text(comparison: Comparison, value: int) -> str:
    if comparison.subject == Subject.MAGIC:
        return bytes_text(value.to_bytes(comparison.size, "big"))
    if comparison.subject == Subject.SENDER:
        return next(end.value for end, number in SENDER_NUMBERS.items() if number == value)
    return str(value)


def part_text(parts: tuple[Part, ...], index: int) -> str:
    """Write one part as a line of the ``frame`` section, without the dash: ``check: {type: xor8, over:
    id..payload}``."""
    if parts[index].in_bits is not None:
        index -= 1  # its text identifies it
    part = parts[index]
    if part.kind not in _SPELLINGS:
        raise NotImplementedError(f"spelling.py has no entry for the part '{part.kind}'")
    options = [f"{part.kind.value}: {_SPELLINGS[part.kind](parts, index)}", *_options(parts, index)]
    if part.kind != PartKind.FIELD and part.name.rstrip("_0123456789") != part.kind.value:
        options.append(f"name: {part.name}")
    if part.condition is not None:
        condition = condition_text(part.condition)
        options.append(f'when: "{condition}"' if "[" in condition else f"when: {condition}")
    text = ", ".join(options)
    return text if len(options) == 1 else f"{{{text}}}"


def _options(parts: tuple[Part, ...], index: int) -> list[str]:
    """Return the options of a part, apart from the key that gives its kind."""
    part = parts[index]
    options = []
    if part.kind == PartKind.FIELD:
        assert part.header is not None
        options += [f"type: {field_type(part.header.value)}", *header_options(part.header)]
    elif part.kind == PartKind.BITS:
        check = _check(parts, index + 1) if any(run.role == BitRole.CHECK for run in part.bits) else ""
        options.append(f"fields: {{{', '.join(_run(run, check) for run in part.bits)}}}")
        options += _length_options(part)
    elif part.kind == PartKind.SEQUENCE:
        assert part.header is not None
        options += header_options(part.header)
    elif part.trims_zeros:
        options.append("trim_zeros: true")
    return options


def sequence_text(header: HeaderField) -> str:
    """Describe what a sequence number counts."""
    return f"rises by one from frame to frame{' of the same message' if header.per_message else ''}"


def header_options(header: HeaderField) -> list[str]:
    """Return the options of a header field, apart from its type: `scale: 0.1`, `default: {host: 255, mcu: 1}`."""
    field = header.value
    options = [f"scale: {_value(field.scale)}"] * (field.scale != 1)
    options += [f"offset: {_value(field.offset)}"] * (field.offset != 0)
    options += [f"unit: {field.unit}"] * bool(field.unit)
    if field.minimum is not None and field.maximum is not None:
        options.append(f"range: [{_value(field.minimum)}, {_value(field.maximum)}]")
    for word, names in (("enum", field.enum), ("flags", field.flags)):
        options += [f"{word}: {{{', '.join(f'{name}: {value}' for name, value in names)}}}"] * bool(names)
    if header.host_default != header.mcu_default:
        options.append(f"default: {{host: {_value(header.host_default)}, mcu: {_value(header.mcu_default)}}}")
    elif header.host_default != 0:
        options.append(f"default: {_value(header.host_default)}")
    options += ["per: message"] * header.per_message
    options += [f"address: {header.address}"] * (header.address is not None)
    if header.broadcast:
        listed = ", ".join(map(_value, header.broadcast))
        options.append(f"broadcast: {listed}" if len(header.broadcast) == 1 else f"broadcast: [{listed}]")
    return options


def _value(value: Fraction | float | int | str) -> str:
    if isinstance(value, str):
        return value
    return str(int(value)) if value == int(value) else repr(float(value))


def _run(run: Bits, check: str) -> str:
    if run.role == BitRole.CONSTANT:
        return f"{run.name}: {{bits: {run.width}, constant: {run.value}}}"
    if run.role == BitRole.CHECK:
        from_bit = f", from_bit: {run.value}" if run.value else ""
        return f"{run.name}: {{bits: {run.width}, check: {check}{from_bit}}}"
    if run.header is None or run.header.value.is_unsigned:
        key, word = "bits", str(run.width)
    else:
        key, word = "type", field_type(run.header.value)
    options = [] if run.header is None else header_options(run.header)
    return f"{run.name}: {{{', '.join([f'{key}: {word}', *options])}}}" if options else f"{run.name}: {word}"


def _constant(parts: tuple[Part, ...], index: int) -> str:
    part = parts[index]
    if part.by_sender:
        ends = dict.fromkeys(end for end, _ in part.by_sender)
        listed = {end: [value for other, value in part.by_sender if other == end] for end in ends}
        return "{" + ", ".join(f"{end.value}: {_any_of(values)}" for end, values in listed.items()) + "}"
    return _any_of(list(part.alternatives or (part.value,)))


def _any_of(magics: list[bytes]) -> str:
    return bytes_text(magics[0]) if len(magics) == 1 else "{any: [" + ", ".join(map(bytes_text, magics)) + "]}"


def _length(parts: tuple[Part, ...], index: int) -> str:
    part = parts[index]
    options = _length_options(part)
    wire = _number(parts, index)
    return f"{{type: {wire}, {', '.join(options)}}}" if options else wire


def _length_options(part: Part) -> list[str]:
    options = []
    if part.counts != LengthCounts.PAYLOAD:
        options.append(f"counts: {part.counts.value}")
    if part.length_offset:
        options.append(f"offset: {part.length_offset}")
    if part.length_unit != 1:
        options.append(f"unit: {part.length_unit}")
    return options


def _number(parts: tuple[Part, ...], index: int) -> str:
    return number_type("u", parts[index].size, parts[index].order)


def _name(parts: tuple[Part, ...], index: int) -> str:
    return parts[index].name


def _reserved(parts: tuple[Part, ...], index: int) -> str:
    return str(parts[index].size)


def _payload(parts: tuple[Part, ...], index: int) -> str:
    part = parts[index]
    return str(part.fixed_payload) if part.payload == PayloadRule.FIXED else part.payload.value


def _parameters(algorithm: Algorithm, order: ByteOrder) -> list[str]:
    """Return the parameters that the algorithm's name does not imply."""
    named = algorithms.find(algorithm.name)
    plain = named or Algorithm(algorithm.name, algorithm.kind, algorithm.width)
    options = [] if named else [f"width: {algorithm.width}"]
    if algorithm.kind == CheckKind.CRC and not named:
        options += [f"poly: {algorithm.poly:#x}", f"init: {algorithm.init:#x}"]
        options += [f"refin: {str(algorithm.refin).lower()}", f"refout: {str(algorithm.refout).lower()}"]
    elif algorithm.init != plain.init:
        options.append(f"init: {algorithm.init:#x}")
    if algorithm.unit != plain.unit:
        options.append(f"unit: {algorithm.unit}")
    usual = plain.unit_order if algorithm.kind == CheckKind.CRC and plain.unit > 1 else order
    if algorithm.unit > 1 and algorithm.unit_order != usual:
        options.append(f"unit_order: {algorithm.unit_order.value}")
    if algorithm.odd != plain.odd:
        options.append(f"odd: {algorithm.odd.value}")
    if algorithm.end_around != plain.end_around:
        options.append("carry: end_around")
    if algorithm.modulus != plain.modulus:
        options.append(f"modulo: {algorithm.modulus}")
    if algorithm.negate != plain.negate:
        options.append("negate: true")
    if algorithm.plus != plain.plus:
        options.append(f"plus: {algorithm.plus:#x}")
    if algorithm.kept != plain.kept:
        options.append(f"mask: {algorithm.kept:#x}")
    if algorithm.xorout != plain.xorout or (algorithm.kind == CheckKind.CRC and not named):
        options.append(f"xorout: {algorithm.xorout:#x}")
    if algorithm.bcd:
        options.append("bcd: true")
    if algorithm.avoided:
        values = ", ".join(f"{low:#x}" if low == high else f"{low:#x}..{high:#x}" for low, high in algorithm.avoided)
        options.append(f"avoid: {{values: [{values}], plus: {algorithm.avoided_plus:#x}}}")
    return options


def _check(parts: tuple[Part, ...], index: int) -> str:
    part = parts[index]
    algorithm = part.algorithm
    assert algorithm is not None
    size = part.size // 2 if part.as_hex else part.size
    options = _parameters(algorithm, part.order)
    if 8 * size < algorithm.width and part.in_bits is None:
        options.append("byte: high" if part.shift else "byte: low")
    if part.ranges != ((0, index - 1 - (part.in_bits is not None)),):
        options.append(f"over: {ranges_text(parts, part.ranges)}")
    if part.as_hex:
        options.append("text: hex")
    if part.as_decimal:
        options.append("text: decimal")
    if part.seeded:
        options.append("seed: message")
    if size > 1 and part.order == ByteOrder.BIG and not (part.as_hex or part.as_decimal):
        options.append("byte_order: big")
    return f"{{type: {algorithm.name}, {', '.join(options)}}}" if options else algorithm.name


# One entry for each kind of part in the model.
_SPELLINGS: dict[PartKind, Callable[[tuple[Part, ...], int], str]] = {
    PartKind.MAGIC: _constant,
    PartKind.CONSTANT: _constant,
    PartKind.TAIL: _constant,
    PartKind.LENGTH: _length,
    PartKind.ID: _number,
    PartKind.RESERVED: _reserved,
    PartKind.PAYLOAD: _payload,
    PartKind.CHECK: _check,
    PartKind.FIELD: _name,
    PartKind.SEQUENCE: _number,
    PartKind.BITS: _number,
}


def match_text(match: Match, digits: int = 2) -> str:
    """Write the allowed numbers after a name: ``0x80..0xFF``, ``8``, ``3 with mask 0x07``. ``digits``: of an id."""

    def spelled(number: int) -> str:
        return f"0x{number:0{digits}X}" if match.of == MatchOf.ID or match.name == "magic" else str(number)

    texts = [spelled(low) if low == high else f"{spelled(low)}..{spelled(high)}" for low, high in match.ranges]
    masked = "" if match.mask == match.whole else f" with mask 0x{match.mask:02X}"
    return ", ".join(texts) + masked


def match_texts(message: Message) -> list[str]:
    """Return what identifies its frames besides the id."""
    return [
        f"{'payload size' if match.of == MatchOf.SIZE else match.name} {match_text(match)}"
        for match in message.match
        if match.of != MatchOf.ID
    ]
