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
    """Long division, one bit at a time, as the definition has it. Incomplete words are padded."""
    padded = data + bytes(-len(data) % a.unit)
    units = [int.from_bytes(padded[i : i + a.unit], a.unit_order.value) for i in range(0, len(padded), a.unit)]
    if a.kind == CheckKind.SUM:
        total = sum(units)
        while a.end_around and total >= 2**a.width:
            total = total % 2**a.width + total // 2**a.width
        return (-total if a.negate else total) % 2**a.width ^ a.xorout
    if a.kind == CheckKind.FLETCHER:
        half = 2 ** (a.width // 2)
        first = (a.init + sum(units)) % a.modulus
        second = sum(a.init + sum(units[: i + 1]) for i in range(len(units))) % a.modulus
        return second * half + first
    if a.kind == CheckKind.XOR:
        result = 0
        for unit in units:
            result ^= unit
        return result
    register = a.init
    for unit in units:
        bits = f"{unit:0{8 * a.unit}b}"
        for bit in reversed(bits) if a.refin else bits:
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
    ours = {name for name, algorithm in ALGORITHMS.items() if algorithm.kind == CheckKind.CRC and algorithm.unit == 1}
    assert ours == {other._names[0].lower() for other in crc.ALLCRCCLASSES if other._width <= 64}
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
    assert "such as xor8, xor16" in advice_for_unknown("parity")
