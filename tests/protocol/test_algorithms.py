"""Every check of the catalogue: its published value, worked out bit by bit, and another package's results."""

import pytest
from crccheck import crc

from wirebond.protocol import Algorithm
from wirebond.protocol.algorithms import ALGORITHMS, ALIASES, AMBIGUOUS, CHECK_VALUES, advice_for_unknown, find
from wirebond.protocol.model import CheckKind

DIGITS = b"123456789"


def reversed_bits(value: int, width: int) -> int:
    return int(f"{value:0{width}b}"[::-1], 2)


def slow_check(a: Algorithm, data: bytes) -> int:
    """Long division, one bit at a time, as the definition has it."""
    if a.kind == CheckKind.SUM:
        total = sum(data)
        return (-total if a.negate else total) % 2**a.width ^ a.xorout
    if a.kind == CheckKind.FLETCHER:
        half = 2 ** (a.width // 2)
        first = sum(data) % a.modulus
        second = sum(sum(data[: i + 1]) for i in range(len(data))) % a.modulus
        return second * half + first
    if a.kind == CheckKind.XOR:
        result = 0
        for byte in data:
            result ^= byte
        return result
    register = a.init
    for byte in data:
        for bit in f"{reversed_bits(byte, 8) if a.refin else byte:08b}":
            top = register >> (a.width - 1)
            register = (register << 1) % 2**a.width
            if top != int(bit):
                register ^= a.poly
    return (reversed_bits(register, a.width) if a.refout else register) ^ a.xorout


@pytest.mark.parametrize("name", ALGORITHMS)
def test_every_algorithm_gives_its_published_value(name: str) -> None:
    assert slow_check(ALGORITHMS[name], DIGITS) == CHECK_VALUES[name]


OTHERS = {name.lower(): other for other in crc.ALLCRCCLASSES for name in other._names}
COMMON = [name for name in (*ALGORITHMS, *ALIASES) if name in OTHERS]


@pytest.mark.parametrize("name", COMMON)
def test_names_mean_what_they_mean_elsewhere(name: str) -> None:
    algorithm, data = find(name), bytes(range(256)) * 2
    assert algorithm is not None
    assert slow_check(algorithm, data) == OTHERS[name].calc(data)


def test_the_comparison_covers_the_whole_catalogue() -> None:
    byte_wide = {n for n, other in OTHERS.items() if other._width in (8, 16, 24, 32, 64)}
    assert {name for name in ALGORITHMS if name.startswith("crc-")} <= byte_wide
    assert len(ALGORITHMS) >= 80


def test_an_alias_is_found_under_its_catalogue_name() -> None:
    algorithm = find("crc-16/x-25")
    assert algorithm is not None
    assert algorithm.name == "crc-16/ibm-sdlc"


def test_no_alias_is_a_name_and_every_alias_has_one() -> None:
    assert not set(ALIASES) & set(ALGORITHMS)
    assert set(ALIASES.values()) <= set(ALGORITHMS)


def test_a_name_with_several_meanings_is_not_guessed() -> None:
    assert not set(AMBIGUOUS) & {*ALGORITHMS, *ALIASES}
    assert all(set(meanings) <= set(ALGORITHMS) for meanings in AMBIGUOUS.values())
    assert (
        advice_for_unknown("CRC-CCITT") == "say which: crc-16/kermit, crc-16/ibm-3740, crc-16/xmodem, crc-16/ibm-sdlc"
    )


def test_an_unknown_name_is_answered_with_the_nearest() -> None:
    assert find("crc-16/mcrf4x") is None
    assert advice_for_unknown("CRC-16/MCRF4XX") == "did you mean `crc-16/mcrf4xx`?"
    assert "such as xor8, sum8" in advice_for_unknown("adler")
