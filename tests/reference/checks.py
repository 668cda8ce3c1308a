"""Checks: what they cover, and their values, one bit at a time."""

from __future__ import annotations

import re

from tests.reference.order import order_of
from wirebond.protocol.model import Algorithm, CheckKind, Message, Part


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
    covered = data[sum(sizes[: part.first]) : sum(sizes[: part.last + 1])]
    if part.is_plain and any(not other.is_plain for other in everything[part.first : part.last + 1]):
        covered = wire[sum(sizes[: part.first]) : len(wire) - sum(sizes[part.last + 1 :])]
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
    return found == (checksum(part.algorithm, covered) >> part.shift) % 256**width


def checksum(algorithm: Algorithm, data: bytes) -> int:
    """One bit at a time, as the definition says."""
    width = algorithm.width
    if algorithm.kind == CheckKind.XOR:
        value = algorithm.init
        for byte in data:
            value ^= byte
        return value ^ algorithm.xorout
    if algorithm.kind == CheckKind.SUM:
        value = algorithm.init + sum(data)
        return (-value if algorithm.negate else value) % 2**width ^ algorithm.xorout
    if algorithm.kind == CheckKind.FLETCHER:
        modulus = algorithm.modulus or 2 ** (width // 2)
        first = second = 0
        for byte in data:
            first = (first + byte) % modulus
            second = (second + first) % modulus
        return second << (width // 2) | first
    register = algorithm.init
    for byte in data:
        for bit in range(8):
            incoming = byte >> (bit if algorithm.refin else 7 - bit) & 1
            top = register >> (width - 1) & 1
            register = (register << 1) % 2**width
            if top ^ incoming:
                register ^= algorithm.poly
    if algorithm.refout:
        register = int(f"{register:0{width}b}"[::-1], 2)
    return register ^ algorithm.xorout
