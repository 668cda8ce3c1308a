"""The chapters on the frame: its parts, the rules of a receiver, the check algorithms with code to copy."""

from __future__ import annotations

from dataclasses import replace

from wirebond.analysis.check.wording import seconds
from wirebond.analysis.checksum import checksum
from wirebond.analysis.explain.layout import hex_of, spans
from wirebond.analysis.explain.parts import check_text, rules_of, words_of
from wirebond.generate.doc import snippets
from wirebond.generate.doc.diagram import diagram
from wirebond.generate.doc.table import table
from wirebond.protocol.model import (
    Algorithm,
    BitRole,
    ByteOrder,
    CheckKind,
    FrameFormat,
    OddTail,
    Part,
    PartKind,
    PayloadRule,
    Protocol,
    Stuffing,
    decimal_digits,
)
from wirebond.protocol.spelling import condition_text, field_type, number_type

_NUMBERS = (PartKind.LENGTH, PartKind.ID, PartKind.CHECK, PartKind.FIELD, PartKind.SEQUENCE, PartKind.BITS)


def frame_chapter(protocol: Protocol) -> list[str]:
    frame_format = protocol.format
    lines = ["## Frame", "", "```text", *diagram(frame_format, frame_format.max_payload), "```", ""]
    lines += table(("part", ">offset", ">bytes", "type", "content", "there if"), _rows(protocol))
    lines += [*_bits(frame_format), *_ends(protocol), *_stuffing(frame_format)]
    lines += ["", "### A receiver accepts a frame when", "", *_rules(protocol), ""]
    return lines + _after_a_failure(protocol)


def _rows(protocol: Protocol) -> list[tuple[str, ...]]:
    """Return the rows of the parts. Offsets are given while all earlier parts are always present."""
    parts = protocol.format.parts
    payload = next(i for i, part in enumerate(parts) if part.kind == PartKind.PAYLOAD)
    size = parts[payload].fixed_payload if parts[payload].payload == PayloadRule.FIXED else None
    rows: list[tuple[str, ...]] = []
    firm = True
    for index, ((start, stop), part) in enumerate(zip(spans(parts, size or 0), parts, strict=True)):
        offset = str(start) if index <= payload or size is not None else f"{start} + payload"
        shown = str(stop - start) if index != payload or size is not None else f"0 to {protocol.format.max_payload}"
        if part.as_decimal:
            shown = f"1 to {decimal_digits(part.size)}"
        if part.in_bits is not None:
            continue
        there_if = "" if part.condition is None else f"`{condition_text(part.condition)}`"
        content = words_of(part).content(protocol, index)
        rows.append((part.name, offset if firm else "", shown, _type(part), content, there_if))
        firm = firm and part.condition is None
    return rows


def _type(part: Part) -> str:
    if part.kind not in _NUMBERS or part.as_hex or part.as_decimal:
        return ""
    order = "" if part.size == 1 else ", big-endian" if part.order == ByteOrder.BIG else ", little-endian"
    word = number_type("u", part.size, ByteOrder.LITTLE)
    if part.header is not None:
        word = field_type(replace(part.header.value, order=ByteOrder.LITTLE))
    return word + order


def _bits(frame_format: FrameFormat) -> list[str]:
    lines: list[str] = []
    for part, check in zip(frame_format.parts, (*frame_format.parts[1:], frame_format.parts[0]), strict=True):
        if part.bits:
            rows = [
                (
                    str(run.shift) if run.width == 1 else f"{run.shift} to {run.shift + run.width - 1}",
                    run.name,
                    f"always {run.value}"
                    if run.role == BitRole.CONSTANT
                    else check_text(frame_format.parts, check)
                    if run.role == BitRole.CHECK
                    else "",
                )
                for run in part.bits
            ]
            lines += ["", f"Bits of {part.name}, 0 the lowest:", "", *table((">bit", "name", "value"), rows)]
    return lines


def _ends(protocol: Protocol) -> list[str]:
    frame_format = protocol.format
    if frame_format.ends_by_silence:
        return [
            "",
            f"A frame ends when the line is silent for {seconds(protocol.idle_seconds)}; within it is no pause. Before "
            f"its next frame a sender pauses for {seconds(protocol.pause_seconds)}, so that the receiver notices.",
        ]
    if frame_format.delimiter is None:
        return []
    closing = hex_of(frame_format.delimiter)
    if frame_format.opening is None:
        return ["", f"Every frame ends with {closing}."]
    if frame_format.opening == frame_format.delimiter:
        return ["", f"Every frame begins and ends with {closing}; two frames may share one."]
    return ["", f"Every frame begins with {hex_of(frame_format.opening)} and ends with {closing}."]


def _stuffing(frame_format: FrameFormat) -> list[str]:
    where, checks = _stuffed_parts(frame_format), _checks_and_stuffing(frame_format)
    if frame_format.stuffing == Stuffing.COBS:
        return ["", f"{where} the frame is stuffed with {_COBS[0]}", *_COBS[1:], checks]
    if frame_format.stuffing == Stuffing.HEX:
        return [
            "",
            f"{where} each byte is sent as two hex digits, the high one first, in upper case. {checks} A receiver "
            "takes digits of either case.",
        ]
    if frame_format.stuffing == Stuffing.HEX_AFTER_DIGIT:
        return [
            "",
            f"{where} each byte is sent as two hex digits, the high one first, in upper case; the first byte is below "
            f"16, and sent as one digit. {checks} A receiver takes digits of either case.",
        ]
    if frame_format.insertion is not None:
        after, byte = hex_of(frame_format.insertion.after), frame_format.insertion.byte
        return ["", f"{where} a byte `{byte:02X}` is sent after each `{after}`. {checks}{_sized(frame_format)}"]
    if frame_format.escapes is None:
        return []
    rule = frame_format.escapes
    if rule.doubles:
        return [
            "",
            f"{where} each byte `{rule.escape:02X}` is sent twice. {checks} From such a byte on, a receiver reads "
            "the bytes of a frame in pairs. So it does not take the second of two for a delimiter.",
        ]
    if rule.exclusive_or:
        named = ", ".join(f"`{byte:02X}`" for byte, _ in rule.pairs)
        return [
            "",
            f"{where} each byte {named} is sent as two: the escape `{rule.escape:02X}`, then the byte xor "
            f"`{rule.exclusive_or:02X}`. {checks}{_sized(frame_format)}",
        ]
    rows = [(f"`{byte:02X}`", f"`{rule.escape:02X} {code:02X}`") for byte, code in rule.pairs]
    return ["", f"{where} these bytes are sent as two. {checks}", "", *table(("byte", "sent as"), rows)]


def _sized(frame_format: FrameFormat) -> str:
    """Describe the length of a stuffed frame that it ends."""
    if not frame_format.is_sized:
        return ""
    return f" The length counts the bytes {'as they are sent' if frame_format.length_on_wire else 'before that'}."


def _stuffed_parts(frame_format: FrameFormat) -> str:
    stuffed = [part for part in frame_format.parts if not part.is_plain]
    if len(stuffed) == len(frame_format.parts):
        return "Between the delimiters"
    if len(stuffed) == 1:
        return f"In the {stuffed[0].name}, and nowhere else,"
    return f"From {stuffed[0].name} to {stuffed[-1].name}, and nowhere else,"


def _checks_and_stuffing(frame_format: FrameFormat) -> str:
    late = [part.name for part in frame_format.parts if part.on_wire]
    if not late:
        return "Checks are taken before that."
    verb = "covers" if len(late) == 1 else "cover"
    others = any(part.algorithm is not None and not part.on_wire for part in frame_format.parts)
    return (
        f"{' and '.join(f'`{name}`' for name in late)} {verb} the bytes as they are then sent"
        f"{'; other checks are taken before that' if others else ''}."
    )


_COBS = [
    "COBS (Consistent Overhead Byte Stuffing), so that it holds no",
    "zero. The bytes are cut at each zero into runs; each run is sent after a code byte that is its length plus one,",
    "and the zeros themselves are not sent. A run of 254 bytes or more is cut after 254 bytes, with the code `FF`,",
    "after which no zero is meant.",
]


def _rules(protocol: Protocol) -> list[str]:
    rules = [rule for index in range(len(protocol.format.parts)) for rule in rules_of(protocol, index)]
    if not protocol.format.deliver_unknown:
        rules.append("the id is known, and the payload has a size that the message can have")
    rules = rules or ["its size fits"]
    return [f"- {rule};" for rule in rules[:-1]] + [f"- {rules[-1]}."]


def _after_a_failure(protocol: Protocol) -> list[str]:
    frame_format = protocol.format
    idle = seconds(protocol.idle_seconds)
    lines = []
    if frame_format.deliver_unknown:
        lines += [
            "A frame with an unknown id, or with more payload than the receiver knows, is accepted: the extra bytes",
            "are ignored, so that a newer sender still works.",
            "",
        ]
    if frame_format.ends_by_silence:
        return [*lines, "Where a rule fails, drop all bytes up to the next silence.", ""]
    if frame_format.delimiter is None or frame_format.opening not in (None, frame_format.delimiter):
        search = [
            "If a rule fails, continue the search one byte after the start of the failed frame, not after its end:",
            "a good frame may have begun inside.",
        ]
        if frame_format.is_strict:
            search = [
                "If a rule fails after the bytes that give the frame's size, drop the whole frame; else continue",
                "searching one byte after its start.",
            ]
        return [
            *lines,
            *search,
            f"Give up a frame that stays incomplete for {idle} of silence, and look through its bytes in the same way.",
            "",
        ]
    if frame_format.opening is None:
        return [*lines, "Where a rule fails, drop all bytes up to the next delimiter, and the delimiter with them.", ""]
    return [*lines, "Where a rule fails, drop all bytes up to the next delimiter, which may begin a frame.", ""]


def checks_chapter(protocol: Protocol) -> list[str]:
    algorithms: dict[Algorithm, None] = {}
    for part in protocol.format.parts:
        if part.algorithm is not None:
            algorithms[part.algorithm] = None
    if not algorithms:
        return []
    lines = ["## Check" + ("s" if len(algorithms) > 1 else ""), ""]
    for algorithm in algorithms:
        lines += _algorithm(algorithm)
    for part in protocol.format.parts:
        if part.algorithm is None:
            continue
        if part.in_bits is not None and part.in_bits.width < part.algorithm.width:
            bits = f"bits {part.shift} to {part.shift + part.in_bits.width - 1}"
            lines += [f"Of this value {part.name} carries the {bits} alone.", ""]
        elif part.check_bits < part.algorithm.width and part.in_bits is None:
            byte = "highest" if part.shift else "lowest"
            lines += [f"Of this value {part.name} carries the {byte} byte alone.", ""]
        if part.as_hex:
            lines += [f"{part.name} is sent as {part.size} hex digits, the highest first; either case is accepted.", ""]
        if part.as_decimal:
            digits = f"decimal digits, 1 to {decimal_digits(part.size)} of them, without leading zeros"
            lines += [f"{part.name} is sent as {digits}; receivers also accept leading zeros.", ""]
        if part.in_bits is not None and protocol.format.parts.index(part) - 1 in part.covered:
            lines += [f"The bits of {part.name} itself count as zeros.", ""]
        if part.seeded:
            lines += [
                f"For {part.name} the check also includes one byte after the range that is not sent: the message's "
                "seed.",
                "",
            ]
    return lines


_ODD_TAILS: dict[str, str] = {
    OddTail.PAD: "zero bytes complete the unit",
    OddTail.XOR: "each is combined with the value by exclusive-or",
    OddTail.REFUSE: "refused",
}


def _algorithm(algorithm: Algorithm) -> list[str]:
    width = (algorithm.width + 3) // 4
    digits = "123456789"[: 8 if algorithm.odd == OddTail.REFUSE else 9]  # 8: any unit divides it
    value = checksum(algorithm, digits.encode())
    rows = [("kind", algorithm.kind), ("width", f"{algorithm.width} bits")]
    if algorithm.kind == CheckKind.CRC:
        rows.append(("poly", f"0x{algorithm.poly:0{width}X}"))
    rows += [("init", f"0x{algorithm.init:0{width}X}")]
    if algorithm.kind == CheckKind.CRC:
        rows += [("refin", str(algorithm.refin).lower()), ("refout", str(algorithm.refout).lower())]
    if algorithm.unit > 1:
        rows.append(("unit", f"{algorithm.unit} bytes, {algorithm.unit_order.value}-endian"))
        rows.append(("bytes after the last unit", _ODD_TAILS[algorithm.odd]))
    if algorithm.kind == CheckKind.FLETCHER:
        rows.append(("modulus of both sums", str(algorithm.modulus or 1 << algorithm.width // 2)))
    elif algorithm.modulus:
        rows.append(("modulus", str(algorithm.modulus)))
    if algorithm.end_around:
        rows.append(("carry", "out of the highest bit, added at the lowest"))
    if algorithm.negate:
        rows.append(("two's complement of the value", "yes"))
    if algorithm.plus:
        rows.append(("added to it", f"0x{algorithm.plus:0{width}X}"))
    if algorithm.kept != (1 << algorithm.width) - 1:
        rows.append(("mask", f"0x{algorithm.kept:0{width}X}"))
    rows.append(("xorout", f"0x{algorithm.xorout:0{width}X}"))
    if algorithm.bcd:
        rows.append(("form", "decimal digits of four bits each"))
    if algorithm.avoided:
        values = ", ".join(
            f"0x{low:02X}" if low == high else f"0x{low:02X}..0x{high:02X}" for low, high in algorithm.avoided
        )
        rows.append(("values that are not sent", values))
        rows.append(("added to such a value", f"0x{algorithm.avoided_plus:02X}"))
    rows.append((f'value over "{digits}"', f"0x{value:0{width}X}"))
    return [
        f"### {algorithm.name}",
        "",
        *table(("parameter", "value"), rows),
        "",
        "```c",
        *snippets.c_function(algorithm),
        "```",
        "",
        "```python",
        *snippets.python_function(algorithm),
        "```",
        "",
    ]
