"""The way back from the model to the words of a protocol file, for tools that show what to write there.

Only what differs from the format's defaults is written.
"""

from __future__ import annotations

from wirebond.protocol.model import (
    ByteOrder,
    Field,
    FieldKind,
    LengthCounts,
    Part,
    PartKind,
    PayloadRule,
)

_LETTERS = {FieldKind.UNSIGNED: "u", FieldKind.SIGNED: "i", FieldKind.FLOAT: "f"}


def bytes_text(data: bytes) -> str:
    """``0xAA 0x55``, as magics are written."""
    return " ".join(f"0x{byte:02X}" for byte in data)


def number_type(letter: str, size: int, order: ByteOrder) -> str:
    """``u8``, ``u16``, ``u16be``: little-endian is what a file means that says nothing."""
    return f"{letter}{8 * size}" + ("be" if size > 1 and order == ByteOrder.BIG else "")


def field_type(field: Field) -> str:
    """``i16``, ``f32``, ``text``: the word behind ``type:``."""
    letter = _LETTERS.get(field.kind)
    return field.kind.value if letter is None else number_type(letter, field.size, field.order)


def range_text(parts: tuple[Part, ...], first: int, last: int) -> str:
    """``id..payload``, or ``payload`` alone, as behind ``over:``."""
    return parts[first].name if first == last else f"{parts[first].name}..{parts[last].name}"


def part_text(parts: tuple[Part, ...], index: int) -> str:
    """One part as a line of the ``frame`` section, without the dash: ``check: {type: xor8, over: id..payload}``."""
    part = parts[index]
    if part.kind not in _SPELLINGS:
        raise NotImplementedError(f"spelling.py has no entry for the part '{part.kind}'")
    named = f", name: {part.name}" if part.name.rstrip("_0123456789") != part.kind.value else ""
    text = f"{part.kind.value}: {_SPELLINGS[part.kind](parts, index)}"
    return f"{{{text}{named}}}" if named else text


def _constant(parts: tuple[Part, ...], index: int) -> str:
    return bytes_text(parts[index].value)


def _length(parts: tuple[Part, ...], index: int) -> str:
    part = parts[index]
    wire = number_type("u", part.size, part.order)
    options = []
    if part.counts != LengthCounts.PAYLOAD:
        options.append(f"counts: {part.counts.value}")
    if part.length_offset:
        options.append(f"offset: {part.length_offset}")
    return f"{{type: {wire}, {', '.join(options)}}}" if options else wire


def _id(parts: tuple[Part, ...], index: int) -> str:
    return number_type("u", parts[index].size, parts[index].order)


def _reserved(parts: tuple[Part, ...], index: int) -> str:
    return str(parts[index].size)


def _payload(parts: tuple[Part, ...], index: int) -> str:
    part = parts[index]
    return str(part.fixed_payload) if part.payload == PayloadRule.FIXED else part.payload.value


def _check(parts: tuple[Part, ...], index: int) -> str:
    part = parts[index]
    algorithm = part.algorithm
    assert algorithm is not None
    options = []
    if algorithm.name == "crc":
        options += [f"width: {algorithm.width}", f"poly: {algorithm.poly:#x}", f"init: {algorithm.init:#x}"]
        options += [f"refin: {str(algorithm.refin).lower()}", f"refout: {str(algorithm.refout).lower()}"]
        options.append(f"xorout: {algorithm.xorout:#x}")
    if 8 * part.size < algorithm.width:
        options.append("byte: high" if part.shift else "byte: low")
    if (part.first, part.last) != (0, index - 1):
        options.append(f"over: {range_text(parts, part.first, part.last)}")
    if part.size > 1 and part.order == ByteOrder.BIG:
        options.append("byte_order: big")
    return f"{{type: {algorithm.name}, {', '.join(options)}}}" if options else algorithm.name


# One entry for each kind of part in the model.
_SPELLINGS = {
    PartKind.MAGIC: _constant,
    PartKind.CONSTANT: _constant,
    PartKind.TAIL: _constant,
    PartKind.LENGTH: _length,
    PartKind.ID: _id,
    PartKind.RESERVED: _reserved,
    PartKind.PAYLOAD: _payload,
    PartKind.CHECK: _check,
}
