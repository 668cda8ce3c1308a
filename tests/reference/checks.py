"""Checks: what they cover, and their values, one bit at a time."""

from __future__ import annotations

import re

from tests.reference.order import order_of
from wirebond.protocol.model import Algorithm, CheckKind, Message, OddTail, Part


def check_holds(
    everything: tuple[Part, ...],
    present: tuple[Part, ...],
    index: int,
    data: bytes,
    wire: bytes,
    payload_at: int,
    payload_size: int,
    message: Message | None,
) -> bool:
    """``wire``: what ``data`` was before unstuffing. ``index`` and ``payload_at`` count all parts of the format, there
    or not: those that are not have no bytes.
    """
    there = {id(p) for p in present}
    sizes = [payload_size if i == payload_at else p.size if id(p) in there else 0 for i, p in enumerate(everything)]
    part = everything[index]
    assert part.algorithm is not None
    if part.in_bits is not None:
        return _run_holds(everything, sizes, index, data, message)
    covered = b"".join(data[sum(sizes[:first]) : sum(sizes[: last + 1])] for first, last in part.ranges)
    if part.is_plain and any(not everything[i].is_plain for i in part.covered):
        behind = max(i for i, other in enumerate(everything) if not other.is_plain) + 1  # the stuffed parts
        places = [sum(sizes[:i]) if i < behind else len(wire) - sum(sizes[i:]) for i in range(len(everything) + 1)]
        covered = b"".join(wire[places[first] : places[last + 1]] for first, last in part.ranges)
    if part.seeded:
        covered += bytes([message.seed or 0 if message is not None else 0])
    at = sum(sizes[:index])
    piece = data[at : at + part.size]
    width = part.size
    if part.as_hex:
        width //= 2
        if not re.fullmatch(rb"[0-9A-Fa-f]*", piece):
            return False
        found = int(piece, 16)
    else:
        found = int.from_bytes(piece, order_of(part.order))
    value = checksum(part.algorithm, covered)
    return value >= 0 and found == (value >> part.shift) % 256**width


def _run_holds(
    everything: tuple[Part, ...], sizes: list[int], index: int, data: bytes, message: Message | None
) -> bool:
    """Of a check that has some bits of the part before it. These count as zeros."""
    part, holder = everything[index], everything[index - 1]
    assert part.algorithm is not None
    assert part.in_bits is not None
    start, stop = sum(sizes[: index - 1]), sum(sizes[:index])
    bits = f"{int.from_bytes(data[start:stop], order_of(holder.order)):0{8 * holder.size}b}"[::-1]
    low, high = part.in_bits.shift, part.in_bits.shift + part.in_bits.width
    found = int(bits[low:high][::-1], 2)
    others = int((bits[:low] + "0" * (high - low) + bits[high:])[::-1], 2)
    cleared = data[:start] + others.to_bytes(holder.size, order_of(holder.order)) + data[stop:]
    covered = b"".join(cleared[sum(sizes[:first]) : sum(sizes[: last + 1])] for first, last in part.ranges)
    if part.seeded:
        covered += bytes([message.seed or 0 if message is not None else 0])
    value = checksum(part.algorithm, covered)
    return value >= 0 and value // 2**part.in_bits.value % 2 ** (high - low) == found


def checksum(algorithm: Algorithm, data: bytes) -> int:
    """One bit at a time, as the definition says. -1, which no frame holds, where no value fits."""
    size, order = algorithm.unit, order_of(algorithm.unit_order)
    odd = len(data) % size
    tail = b""
    if odd and algorithm.odd == OddTail.REFUSE:
        return -1
    if odd and algorithm.odd == OddTail.PAD:
        data += bytes(size - odd)
    elif odd:
        data, tail = data[:-odd], data[-odd:]
    numbers = [int.from_bytes(data[i : i + size], order) for i in range(0, len(data), size)]
    value = _REGISTERS[algorithm.kind](algorithm, numbers)
    for byte in tail:
        value ^= byte
    every = 2**algorithm.width - 1
    value = (-value if algorithm.negate else value) + algorithm.plus
    value = (value & (every if algorithm.mask is None else algorithm.mask) & every) ^ algorithm.xorout
    if algorithm.bcd:
        value = sum(value // 10**digit % 10 * 16**digit for digit in range(algorithm.width // 4))
    for low, high in algorithm.avoided:
        if value in range(low, high + 1):
            return (value + algorithm.avoided_plus) % 2**algorithm.width
    return value


def _exclusive_or(algorithm: Algorithm, numbers: list[int]) -> int:
    value = algorithm.init
    for number in numbers:
        value ^= number
    return value


def _sum(algorithm: Algorithm, numbers: list[int]) -> int:
    value = algorithm.init
    for number in numbers:
        value += number
        if algorithm.end_around:
            while value >= 2**algorithm.width:
                value = value % 2**algorithm.width + value // 2**algorithm.width
        else:
            value %= algorithm.modulus or 2**algorithm.width
    return value


def _fletcher(algorithm: Algorithm, numbers: list[int]) -> int:
    half = algorithm.width // 2
    modulus = algorithm.modulus or 2**half
    second, first = divmod(algorithm.init, 2**half)
    for number in numbers:
        first = (first + number) % modulus
        second = (second + first) % modulus
    return second << half | first


def _crc(algorithm: Algorithm, numbers: list[int]) -> int:
    width, bits = algorithm.width, 8 * algorithm.unit
    register = algorithm.init
    for number in numbers:
        for bit in range(bits):
            incoming = number >> (bit if algorithm.refin else bits - 1 - bit) & 1
            top = register >> (width - 1) & 1
            register = (register << 1) % 2**width
            if top ^ incoming:
                register ^= algorithm.poly
    return int(f"{register:0{width}b}"[::-1], 2) if algorithm.refout else register


_REGISTERS = {
    CheckKind.CRC: _crc,
    CheckKind.SUM: _sum,
    CheckKind.XOR: _exclusive_or,
    CheckKind.FLETCHER: _fletcher,
}
