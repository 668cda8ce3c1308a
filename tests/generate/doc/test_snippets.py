"""The code that the document gives away: compiled as C99 without a warning, run as Python, and right."""

from __future__ import annotations

import random
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.random_checks import algorithm_of, random_check

from wirebond.analysis.checksum import checksum
from wirebond.generate.doc import snippets
from wirebond.protocol.algorithms import ALGORITHMS
from wirebond.protocol.model import Algorithm, CheckKind, OddTail

# Beside the catalogue: what a file may give by its parameters, and what no catalogue entry has.
OWN = [
    Algorithm("own-1", CheckKind.CRC, 16, 0x1021, 0x1234, refin=True, refout=False, xorout=0x5555),
    Algorithm("own-2", CheckKind.CRC, 32, 0x04C11DB7, 0xFFFFFFFF, refin=False, refout=True, xorout=0xFFFFFFFF),
    Algorithm("own-3", CheckKind.CRC, 64, 0x42F0E1EBA9EA3693, 0x1, refin=True, refout=False),
    Algorithm("own-4", CheckKind.CRC, 8, 0x07, 0xAB, refin=False, refout=True, xorout=0x01),
    Algorithm("own-5", CheckKind.SUM, 16, init=0x1234, xorout=0xFFFF),
    Algorithm("own-6", CheckKind.FLETCHER, 16, init=0x0102, modulus=255, negate=True),
]
CHANCE = random.Random("snippets")
DRAWN = [
    replace(found, name=f"drawn-{number}")
    for number in range(60)
    if (found := algorithm_of(random_check(CHANCE)[0])).odd != OddTail.REFUSE
]
EVERY = [*ALGORITHMS.values(), *OWN, *DRAWN]
DATA = [b"", b"\0", b"123456789", bytes(range(256)), b"\xff" * 300]


@pytest.mark.live
def test_c_functions_give_the_check(tmp_path: Path) -> None:
    lines = ["#include <inttypes.h>", "#include <stdio.h>"]
    for algorithm in EVERY:
        lines += snippets.c_function(algorithm)
    lines += ["int main(void) {", "  uint8_t data[300];"]
    for data in DATA:
        values = ", ".join(str(byte) for byte in data) or "0"
        lines.append(f"  {{ const uint8_t source[] = {{{values}}}; size_t size = {len(data)};")
        lines.append("    for (size_t i = 0; i < size; ++i) data[i] = source[i];")
        lines += [
            f'    printf("%" PRIu64 "\\n", (uint64_t){snippets.function_name(algorithm)}(data, size));'
            for algorithm in EVERY
        ]
        lines.append("  }")
    lines += ["  return 0;", "}"]
    source, program = tmp_path / "checks.c", tmp_path / "checks"
    source.write_text("\n".join(lines))
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-fsanitize=undefined"]
    subprocess.run(["gcc", *flags, str(source), "-o", str(program)], check=True)
    printed = subprocess.run([str(program)], capture_output=True, text=True, check=True)
    assert printed.stderr == ""
    expected = [checksum(algorithm, data) for data in DATA for algorithm in EVERY]
    assert [int(line) for line in printed.stdout.split()] == expected


@pytest.mark.parametrize("algorithm", EVERY, ids=lambda algorithm: algorithm.name)
def test_python_functions_give_the_check(algorithm: Algorithm) -> None:
    scope: dict[str, Any] = {}
    exec("\n".join(snippets.python_function(algorithm)), scope)
    for data in DATA:
        assert scope[snippets.function_name(algorithm)](data) == checksum(algorithm, data)
