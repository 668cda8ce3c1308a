"""Every algorithm of the catalogue, worked out in Python, against the catalogue's published values."""

from __future__ import annotations

from dataclasses import replace

import pytest
from tests.reference.checks import checksum as by_bits

from wirebond.analysis.checksum import checksum
from wirebond.protocol.algorithms import ALGORITHMS, CHECK_VALUES
from wirebond.protocol.model import Algorithm, CheckKind


@pytest.mark.parametrize("name", ALGORITHMS)
def test_gives_the_published_value(name: str) -> None:
    assert checksum(ALGORITHMS[name], b"123456789") == CHECK_VALUES[name]


def test_a_crc_reflected_on_one_side_is_its_result_mirrored() -> None:
    plain = Algorithm("crc", CheckKind.CRC, 16, 0x1021, 0xFFFF)
    mirrored = Algorithm("crc", CheckKind.CRC, 16, 0x1021, 0xFFFF, refout=True)
    value = checksum(plain, b"123456789")
    assert checksum(mirrored, b"123456789") == int(f"{value:016b}"[::-1], 2)


def test_sums_and_exclusive_ors_keep_init_and_final_xor() -> None:
    assert checksum(Algorithm("sum", CheckKind.SUM, 8, init=1, xorout=0xFF), b"\x02\xff") == (1 + 2 + 255) % 256 ^ 0xFF
    assert checksum(Algorithm("xor", CheckKind.XOR, 8, init=0x5A, xorout=0x0F), b"\x01") == 0x5A ^ 0x01 ^ 0x0F


@pytest.mark.parametrize("width", range(3, 8))
@pytest.mark.parametrize("refin", [False, True])
@pytest.mark.parametrize("refout", [False, True])
def test_a_crc_of_fewer_than_eight_bits_ends_as_its_definition_says(width: int, refin: bool, refout: bool) -> None:
    every = 2**width - 1
    plain = Algorithm("crc", CheckKind.CRC, width, 3, 1, refin, refout)
    for more in ({}, {"negate": True}, {"plus": every}, {"negate": True, "plus": 2, "mask": every >> 1, "xorout": 1}):
        algorithm = replace(plain, **more)
        for data in (b"", b"\0", b"123456789", bytes(range(256))):
            assert checksum(algorithm, data) == by_bits(algorithm, data)
