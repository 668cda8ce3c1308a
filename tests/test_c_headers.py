"""The generated C API of frames with header fields and addresses: a C program sends and receives them."""

from __future__ import annotations

from pathlib import Path

import pytest

import wirebond
from tests.compilers import CC, CXX, SANITIZE_FOR_C
from tests.shared import PROTOCOLS, ROOT
from tests.test_c_api import C_COMPILERS, CPP, CPP_COMPILERS, LONG, QUICK, STRICT, run
from wirebond.generate.code import generate_c
from wirebond.protocol.loader import loads

pytestmark = pytest.mark.live

PROGRAM = ROOT / "tests" / "mcu_link" / "c_header_test.c"
VERSIONS = ROOT / "tests" / "mcu_link" / "c_version_test.c"
EVERY_HEADER = ROOT / "tests" / "generate" / "code" / "every_header.yaml"


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("c_headers")
    generate_c(wirebond.load(EVERY_HEADER).model, folder)
    return folder


def test_a_program_in_c_sends_and_receives_header_values(generated: Path, tmp_path: Path) -> None:
    objects = []
    for name in ("headers", "headers_link"):
        objects.append(str(tmp_path / f"{name}.o"))
        source = str(generated / f"{name}.cpp")
        run([CXX, *CPP, *QUICK, *SANITIZE_FOR_C, f"-I{generated}", "-c", source, "-o", objects[-1]])
    built = tmp_path / "program"
    run([CC, "-std=c99", *STRICT, *SANITIZE_FOR_C, f"-I{generated}", str(PROGRAM), *objects, "-o", str(built)])
    assert run([str(built)]) == "0\n"


def test_a_link_in_c_answers_in_the_version_that_it_was_asked_in(tmp_path: Path) -> None:
    generate_c(wirebond.load(PROTOCOLS / "contrib" / "msp.yaml").model, tmp_path)
    objects = []
    for name in ("msp", "msp_link"):
        objects.append(str(tmp_path / f"{name}.o"))
        run(
            [
                CXX,
                *CPP,
                *QUICK,
                *SANITIZE_FOR_C,
                f"-I{tmp_path}",
                "-c",
                str(tmp_path / f"{name}.cpp"),
                "-o",
                objects[-1],
            ]
        )
    built = tmp_path / "program"
    run([CC, "-std=c99", *STRICT, *SANITIZE_FOR_C, f"-I{tmp_path}", str(VERSIONS), *objects, "-o", str(built)])
    assert run([str(built)]) == "0\n"


@pytest.mark.parametrize("compiler", [*(pytest.param(c, marks=LONG) for c in C_COMPILERS if not c.endswith("cpp"))])
def test_program_is_plain_c_everywhere(compiler: str, generated: Path) -> None:
    run([*C_COMPILERS[compiler], *STRICT, f"-I{generated}", "-fsyntax-only", str(PROGRAM)])


@pytest.mark.parametrize(
    "compiler", ["cortex-m0", *(pytest.param(c, marks=LONG) for c in ("gcc", "clang", "cortex-m4"))]
)
@pytest.mark.parametrize("optimise", ["-O0", *(pytest.param(level, marks=LONG) for level in ("-O2", "-Os"))])
def test_source_compiles_without_a_warning(compiler: str, optimise: str, generated: Path, tmp_path: Path) -> None:
    for name in ("headers", "headers_link"):
        source = str(generated / f"{name}.cpp")
        command = [*CPP_COMPILERS[compiler], *CPP, optimise, f"-I{generated}", "-c", source]
        run([*command, "-o", str(tmp_path / "made.o")])


NAMES_THAT_MEET = """
wirebond: 1
protocol: hard
frame:
  - magic: 0xAA
  - {field: servo, type: u8, address: mcu}
  - {field: restrict, type: u8, flags: {size: 0}}
  - length: u8
  - id: u8
  - payload: by_length
  - check: crc-16/modbus
messages:
  header: {id: 1, sender: both, every: 1 s, fields: {header: {type: u8}}}
  header_with_header: {id: 2, sender: both, every: 1 s, fields: {numbers: {type: u8}}}
  move: {id: 3, sender: host}
  move_with_header: {id: 4, sender: host}
  address: {id: 5, sender: mcu}
deadlines:
  - {message: move, at: mcu, after: 1 s, then: move_with_header_2}
  - {message: move, at: mcu, after: 2 s, then: move}
"""


def test_names_that_are_hard_on_headers_do_not_meet(tmp_path: Path) -> None:
    """Messages that are called as the header's struct, its functions and the members of their tables."""
    generate_c(loads(NAMES_THAT_MEET), tmp_path)
    for name in ("hard", "hard_link"):
        run(["gcc", "-std=c99", *STRICT, "-fsyntax-only", "-x", "c", f"-I{tmp_path}", str(tmp_path / f"{name}.h")])
        run(["g++", *CPP, "-fsyntax-only", f"-I{tmp_path}", str(tmp_path / f"{name}.cpp")])
