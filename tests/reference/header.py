"""The parts around the payload: what is fixed in them, what they tell, and what header fields mean."""

from __future__ import annotations

from tests.reference.conditions import Header, Sizes, truth
from tests.reference.order import order_of
from tests.reference.outcome import Incomplete, Rejected
from wirebond.protocol.model import BitRole, End, Field, Part, PartKind

CONSTANTS = (PartKind.CONSTANT, PartKind.TAIL)


def magics_of(part: Part, sender: End | None) -> list[bytes]:
    if part.by_sender:
        return [value for end, value in part.by_sender if sender in (None, end)]
    return list(part.alternatives or (part.value,))


def read_header(parts: tuple[Part, ...], data: bytes, header: Header, sizes: Sizes) -> tuple[Header, list[Part]]:
    """Part by part: constants as soon as their bytes are there, then what the numbers say."""
    sender = header.sender
    present: list[Part] = []
    at = 0
    for part in parts:
        if part.condition is not None and truth(part.condition, header, sizes) is not True:
            continue
        present.append(part)
        piece = data[at : at + part.size]
        if part.kind == PartKind.MAGIC:
            found = [m for m in magics_of(part, sender) if m[: len(piece)] == piece]
            if not found:
                raise Rejected("constant_mismatch", 1)
            header.magic = found[0]
        if part.kind in CONSTANTS and part.value[: len(piece)] != piece:
            raise Rejected("constant_mismatch", 1)
        if not fixed_bits_hold(part, piece):
            raise Rejected("constant_mismatch", 1)
        if len(piece) < part.size:
            raise Incomplete
        number = int.from_bytes(piece, order_of(part.order))
        if part.kind == PartKind.ID:
            header.id = number
        elif part.kind == PartKind.LENGTH:
            header.length = number
        elif part.kind in (PartKind.FIELD, PartKind.SEQUENCE):
            header.numbers[part.name] = number
        for run in part.bits:
            value = number >> run.shift & run.mask
            if run.role == BitRole.ID:
                header.id = value
            elif run.role == BitRole.LENGTH:
                header.length = value
            else:
                header.numbers[run.name] = value
        at += part.size
    return header, present


def fixed_bits_hold(part: Part, piece: bytes) -> bool:
    """Have those bytes of the part that are there the bits that never change?"""
    runs = [run for run in part.bits if run.role == BitRole.CONSTANT]
    masks = sum(run.mask << run.shift for run in runs).to_bytes(part.size, order_of(part.order))
    values = sum(run.value << run.shift for run in runs).to_bytes(part.size, order_of(part.order))
    return all(byte & mask == value for byte, mask, value in zip(piece, masks, values, strict=False))


def header_values(parts: tuple[Part, ...], data: bytes, payload_size: int) -> dict[str, object]:
    """What the header fields of these parts mean, by name."""
    found: dict[str, object] = {}
    at = 0
    for part in parts:
        size = payload_size if part.kind == PartKind.PAYLOAD else part.size
        number = int.from_bytes(data[at : at + size], "big" if part.kind == PartKind.MAGIC else order_of(part.order))
        at += size
        if part.header is not None:
            found[part.header.name] = meant_by(part.header.value, 8 * part.size, number)
        for run in part.bits:
            if run.header is not None:
                found[run.header.name] = meant_by(run.header.value, run.width, number >> run.shift & run.mask)
    return found


def meant_by(field: Field, width: int, bits: int) -> object:
    """A number's bits as the API gives them."""
    value = bits
    if field.coding.is_signed and bits >> (width - 1):
        value = -(bits - 2 ** (width - 1)) if field.coding.name == "sign_magnitude" else bits - 2**width
    names = {number: name for name, number in field.enum}
    if value in names:
        return names[value]
    if field.flags:
        known = [name for name, bit in field.flags if bits >> bit & 1]
        taken = sum(1 << bit for _, bit in field.flags)
        return known + [1 << bit for bit in range(width) if bits & ~taken & 1 << bit]
    if field.scale != 1 or field.offset != 0:
        return float(value * field.scale + field.offset)
    return value
