"""Computes the places of a frame's parts, and the bytes of a part's value. Written from the model alone."""

from __future__ import annotations

from typing import Literal

from wirebond.analysis.checksum import checksum
from wirebond.protocol.model import BitRole, ByteOrder, LengthCounts, Part, PartKind, Subject
from wirebond.protocol.model.forms import Choice

CONSTANTS = (PartKind.MAGIC, PartKind.CONSTANT, PartKind.TAIL)


def hex_of(data: bytes) -> str:
    return data.hex(" ").upper()


def _order(part: Part) -> Literal["big", "little"]:
    return "big" if part.order == ByteOrder.BIG else "little"


def read_number(part: Part, data: bytes) -> int:
    return int.from_bytes(data, "big" if part.order == ByteOrder.BIG else "little")


def payload_index(parts: tuple[Part, ...]) -> int:
    return next(i for i, part in enumerate(parts) if part.kind == PartKind.PAYLOAD)


def index_with(parts: tuple[Part, ...], kind: PartKind, role: BitRole) -> int | None:
    """Return the part of this kind, or the one with such a run of bits."""
    found = (i for i, p in enumerate(parts) if p.kind == kind or any(run.role == role for run in p.bits))
    return next(found, None)


def length_index(parts: tuple[Part, ...]) -> int | None:
    return index_with(parts, PartKind.LENGTH, BitRole.LENGTH)


def id_index(parts: tuple[Part, ...]) -> int | None:
    return index_with(parts, PartKind.ID, BitRole.ID)


def id_text(parts: tuple[Part, ...], number: int) -> str:
    """Write the id with as many digits as it has on the wire."""
    index = id_index(parts)
    return f"0x{number:0{2 * parts[index].size if index is not None else 2}X}"


def run_value(part: Part, number: int, role: BitRole) -> int:
    """Return the value of a number part in this role: the whole number, or its run of bits."""
    run = next((run for run in part.bits if run.role == role), None)
    return number if run is None else number >> run.shift & run.mask


def spans(parts: tuple[Part, ...], payload_size: int) -> list[tuple[int, int]]:
    """Return where each part begins and ends."""
    found = []
    at = 0
    for part in parts:
        size = payload_size if part.kind == PartKind.PAYLOAD else part.size
        found.append((at, at + size))
        at += size
    return found


def counted_beside_payload(parts: tuple[Part, ...], index: int) -> int:
    """Return how many bytes the length part at ``index`` counts besides the payload, its offset included."""
    part = parts[index]
    follows = sum(p.size for p in parts[index + 1 :])
    return (
        part.length_offset
        + {
            LengthCounts.PAYLOAD: 0,
            LengthCounts.REST: follows,
            LengthCounts.SELF_AND_REST: part.size + follows,
            LengthCounts.FRAME: sum(p.size for p in parts),
        }[part.counts]
    )


def covered_bytes(parts: tuple[Part, ...], index: int, data: bytes, places: list[tuple[int, int]]) -> bytes:
    """Return the bytes that a check covers, in its order. ``places``: of all parts in ``data``."""
    part = parts[index]
    run = part.in_bits
    if run is not None and index - 1 in part.covered:  # its own bits count as zeros
        holder, (start, stop) = parts[index - 1], places[index - 1]
        others = read_number(holder, data[start:stop]) & ~(run.mask << run.shift)
        data = data[:start] + others.to_bytes(holder.size, _order(holder)) + data[stop:]
    first, last = part.ranges[0]
    covered = data[places[first][0] : places[last][1]]
    for first, last in part.ranges[1:]:
        covered += data[places[first][0] : places[last][1]]
    return covered


def found_check(parts: tuple[Part, ...], index: int, data: bytes, places: list[tuple[int, int]]) -> bytes:
    """Return the check of a frame. For a run of bits: its number, highest byte first."""
    run = parts[index].in_bits
    start, stop = places[index if run is None else index - 1]
    if run is None:
        return data[start:stop]
    number = read_number(parts[index - 1], data[start:stop]) >> run.shift & run.mask
    return number.to_bytes((run.width + 7) // 8, "big")


def with_check(parts: tuple[Part, ...], index: int, data: bytes, places: list[tuple[int, int]], value: bytes) -> bytes:
    """Return the frame with this value, as `check_value` gives it, as its check."""
    run = parts[index].in_bits
    start, stop = places[index if run is None else index - 1]
    if run is not None:
        holder = parts[index - 1]
        others = read_number(holder, data[start:stop]) & ~(run.mask << run.shift)
        value = (others | int.from_bytes(value, "big") << run.shift).to_bytes(holder.size, _order(holder))
    return data[:start] + value + data[stop:]


def check_value(part: Part, covered: bytes, seed: int) -> bytes:
    """Return the bytes of a check part over these covered bytes."""
    assert part.algorithm is not None
    size = part.size // 2 if part.as_hex else part.size
    value = checksum(part.algorithm, covered + bytes([seed]) if part.seeded else covered) >> part.shift
    if part.in_bits is not None:
        return (value & part.in_bits.mask).to_bytes((part.in_bits.width + 7) // 8, "big")
    value &= (1 << 8 * size) - 1
    if part.as_hex:
        return f"{value:0{part.size}X}".encode()
    return value.to_bytes(size, "big" if part.order == ByteOrder.BIG else "little")


def same_check(part: Part, expected: bytes, found: bytes) -> bool:
    """Compare two check values; hex digits may be of either case."""
    return found.upper() == expected if part.as_hex else found == expected


def shown_check(part: Part, value: bytes) -> str:
    if part.as_decimal:
        return str(int.from_bytes(value, "big"))
    return value.decode("ascii", errors="replace") if part.as_hex else hex_of(value)


def fixed_bits(part: Part, choices: tuple[Choice, ...]) -> tuple[int, int]:
    """Return mask and value of the bits of a number part that cannot vary in this form."""
    mask = value = 0
    for run in part.bits:
        if run.role == BitRole.CONSTANT:
            mask |= run.mask << run.shift
            value |= run.value << run.shift
    for choice in choices:
        shift, bits = shift_of(part, choice), choice.fixed_bits
        if shift is not None and bits is not None:
            mask |= bits[0] << shift
            value |= bits[1] << shift
    return mask, value


def shift_of(part: Part, choice: Choice) -> int | None:
    """Return the position of a choice's number in this part, or None if it is not in it."""
    if choice.subject == Subject.ID and part.kind == PartKind.ID:
        return 0
    if choice.subject == Subject.FIELD and part.header is not None and part.header.name == choice.name:
        return 0
    for run in part.bits:
        is_id = choice.subject == Subject.ID and run.role == BitRole.ID
        if is_id or (choice.subject == Subject.FIELD and run.header is not None and run.header.name == choice.name):
            return run.shift
    return None
