"""The values of checks, one bit at a time."""

from __future__ import annotations

from typing import Literal

from wirebond.protocol.model import Algorithm, ByteOrder, CheckKind, OddTail


def checksum(algorithm: Algorithm, data: bytes) -> int:
    """One bit at a time, as the definition says. -1, which no frame holds, where no value fits."""
    size = algorithm.unit
    order: Literal["little", "big"] = "big" if algorithm.unit_order == ByteOrder.BIG else "little"
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
