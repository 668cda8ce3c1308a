"""A check's value by its algorithm's parameters, in Python: for tools that show their working. Links use the engine."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

from wirebond.protocol.model import Algorithm, CheckKind


def checksum(algorithm: Algorithm, data: bytes) -> int:
    """The algorithm's value over ``data``, before any byte order or shift of the frame. A few MB/s; any thread."""
    if algorithm.kind not in _REGISTERS:
        raise NotImplementedError(f"checksum.py has no entry for the kind of check '{algorithm.kind}'")
    value = _REGISTERS[algorithm.kind](algorithm, data)
    if algorithm.negate:
        value = -value & (1 << algorithm.width) - 1
    return value ^ algorithm.xorout


def _crc(algorithm: Algorithm, data: bytes) -> int:
    width, mask = algorithm.width, (1 << algorithm.width) - 1
    table = _table(width, algorithm.poly, algorithm.refin)
    if algorithm.refin:
        register = _reflected(algorithm.init, width)
        for byte in data:
            register = (register >> 8) ^ table[(register ^ byte) & 0xFF]
    else:
        register = algorithm.init
        top = width - 8
        for byte in data:
            register = (register << 8) & mask ^ table[(register >> top) ^ byte]
    return _reflected(register, width) if algorithm.refin != algorithm.refout else register


def _sum(algorithm: Algorithm, data: bytes) -> int:
    return (algorithm.init + sum(data)) % (1 << algorithm.width)


def _xor(algorithm: Algorithm, data: bytes) -> int:
    value = algorithm.init
    for byte in data:
        value ^= byte
    return value


def _fletcher(algorithm: Algorithm, data: bytes) -> int:
    half = algorithm.width // 2
    modulus = algorithm.modulus or 1 << half
    first, second = algorithm.init & (1 << half) - 1, algorithm.init >> half
    for byte in data:
        first = (first + byte) % modulus
        second = (second + first) % modulus
    return second << half | first


# One entry for each kind of algorithm in the model: the value before the final steps that all kinds share.
_REGISTERS: dict[str, Callable[[Algorithm, bytes], int]] = {
    CheckKind.CRC: _crc,
    CheckKind.SUM: _sum,
    CheckKind.XOR: _xor,
    CheckKind.FLETCHER: _fletcher,
}


def _reflected(value: int, width: int) -> int:
    return int(f"{value:0{width}b}"[::-1], 2)


@lru_cache(maxsize=128)
def _table(width: int, poly: int, reflected: bool) -> tuple[int, ...]:
    """The register after one byte, for each value of that byte."""
    entries = []
    mask = (1 << width) - 1
    mirrored = _reflected(poly, width)
    for byte in range(256):
        register = byte if reflected else byte << (width - 8)
        for _ in range(8):
            if reflected:
                register = (register >> 1) ^ (mirrored if register & 1 else 0)
            else:
                register = (register << 1) & mask ^ (poly if register >> (width - 1) else 0)
        entries.append(register)
    return tuple(entries)
