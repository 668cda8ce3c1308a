"""A check's value by its algorithm's parameters, in Python: for tools that show their working. Links use the engine."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Literal

from wirebond.protocol.model import Algorithm, ByteOrder, CheckKind, OddTail
from wirebond.protocol.registers import register_of


def checksum(algorithm: Algorithm, data: bytes) -> int:
    """Return the algorithm's value over ``data``, before any byte order or shift of the frame. A few MB/s; any thread.

    -1, which no frame holds, if the algorithm refuses bytes after the last whole word.
    """
    if algorithm.kind not in _REGISTERS:
        raise NotImplementedError(f"checksum.py has no entry for the kind of check '{algorithm.kind}'")
    run, shift = register_of(algorithm)
    odd = len(data) % run.unit
    if odd and run.odd == OddTail.REFUSE:
        return -1
    whole, tail = data[: len(data) - odd], data[len(data) - odd :]
    if odd and run.odd == OddTail.PAD:
        whole, tail = data + bytes(run.unit - odd), b""
    value = _REGISTERS[run.kind](run, whole)
    for byte in tail:
        value ^= byte
    if run.refin != run.refout:
        value = _reflected(value, run.width)
    if run.negate:
        value = -value
    value = (value + run.plus & run.kept) ^ run.xorout
    if run.bcd:
        digits = run.width // 4
        value = int(str(value)[-digits:], 16)
    if any(low <= value <= high for low, high in run.avoided):
        value = value + run.avoided_plus & (1 << run.width) - 1
    return value >> shift


def _words(algorithm: Algorithm, data: bytes) -> Iterable[int]:
    """Return the numbers that it runs over: bytes, or words."""
    size = algorithm.unit
    order: Literal["little", "big"] = "little" if algorithm.unit_order == ByteOrder.LITTLE else "big"
    return data if size == 1 else (int.from_bytes(data[i : i + size], order) for i in range(0, len(data), size))


def _crc(algorithm: Algorithm, data: bytes) -> int:
    if algorithm.unit > 1:  # a word's bits enter highest first, or lowest first
        order: Literal["little", "big"] = "little" if algorithm.refin else "big"
        data = b"".join(word.to_bytes(algorithm.unit, order) for word in _words(algorithm, data))
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
    return register


def _sum(algorithm: Algorithm, data: bytes) -> int:
    value = algorithm.init + sum(_words(algorithm, data))
    if algorithm.end_around:
        every = (1 << algorithm.width) - 1
        return value and (value - 1) % every + 1
    return value % (algorithm.modulus or 1 << algorithm.width)


def _xor(algorithm: Algorithm, data: bytes) -> int:
    value = algorithm.init
    for number in _words(algorithm, data):
        value ^= number
    return value


def _fletcher(algorithm: Algorithm, data: bytes) -> int:
    half = algorithm.width // 2
    modulus = algorithm.modulus or 1 << half
    first, second = algorithm.init & (1 << half) - 1, algorithm.init >> half
    for number in _words(algorithm, data):
        first = (first + number) % modulus
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
    """Return the register after one byte, for each value of that byte."""
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
