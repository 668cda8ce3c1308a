"""The generated C API of links: a C program opens, receives, sends and fails on it, without a C++ library."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

import wirebond
from tests.compilers import CC, CXX, SANITIZE_FOR_C
from tests.shared import PROTOCOLS, ROOT
from tests.test_c_api import AWKWARD, C_COMPILERS, CPP, CPP_COMPILERS, LONG, QUICK, STRICT, run
from wirebond.generate.code import generate_c
from wirebond.protocol.loader import loads

pytestmark = pytest.mark.live

PROGRAM = ROOT / "tests" / "mcu_link" / "c_link_test.c"
SIZES = ["-DNATIVE_LINK_COUNT=3", "-DDIFFDRIVE_LINK_RECEIVE_BYTES=64", "-DDIFFDRIVE_LINK_SEND_FRAMES=4"]
NAMES = ("diffdrive", "native")


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("c_link")
    for name in NAMES:
        generate_c(wirebond.load(PROTOCOLS / f"{name}.yaml").model, folder)
    return folder


@pytest.mark.parametrize(
    "sanitize", [pytest.param(SANITIZE_FOR_C, id="sanitized"), pytest.param([], id="plain", marks=LONG)]
)
def test_a_program_in_c_drives_links_over_a_port_in_c(sanitize: list[str], generated: Path, tmp_path: Path) -> None:
    objects = []
    for name in (name + kind for name in NAMES for kind in ("", "_link")):
        objects.append(str(tmp_path / f"{name}.o"))
        command = [CXX, *CPP, *QUICK, *SIZES, f"-I{generated}", "-c", str(generated / f"{name}.cpp")]
        # What links do not call is sanitized in test_c_api.py.
        run([*command, *(sanitize if name.endswith("_link") else []), "-o", objects[-1]])
    built = tmp_path / "program"
    run([CC, "-std=c99", *STRICT, *sanitize, f"-I{generated}", str(PROGRAM), *objects, "-o", str(built)])
    assert run([str(built)]) == "0\n"


@pytest.mark.parametrize("ring", [[], ["-DDIFFDRIVE_LINK_RECEIVE_BYTES=128", "-DIS_STARVED"]], ids=["default", "small"])
def test_the_ring_that_c_has_by_default_serves_a_loop_of_20_ms(
    ring: list[str], generated: Path, tmp_path: Path
) -> None:
    objects = []
    for name in ("diffdrive", "diffdrive_link"):
        objects.append(str(tmp_path / f"{name}.o"))
        run([CXX, *CPP, *QUICK, *ring, f"-I{generated}", "-c", str(generated / f"{name}.cpp"), "-o", objects[-1]])
    built = tmp_path / "program"
    source = str(PROGRAM.with_name("c_slow_loop_test.c"))
    run([CC, "-std=c99", *STRICT, *ring, f"-I{generated}", source, *objects, "-o", str(built)])
    assert run([str(built)]) == "0\n"


# That the headers are C++ as well is shown for all protocols in test_c_api.py.
@pytest.mark.parametrize("compiler", [name for name in C_COMPILERS if not name.endswith("cpp")])
def test_program_is_plain_c_everywhere(compiler: str, generated: Path) -> None:
    run([*C_COMPILERS[compiler], *STRICT, f"-I{generated}", "-fsyntax-only", str(PROGRAM)])


@pytest.mark.parametrize("name", [pytest.param("diffdrive", marks=LONG), "native"])
@pytest.mark.parametrize(
    "compiler", ["cortex-m4", *(pytest.param(c, marks=LONG) for c in ("cortex-m0", "gcc", "clang"))]
)
def test_source_needs_no_cpp_library_and_runs_nothing_before_main(
    compiler: str, name: str, generated: Path, tmp_path: Path
) -> None:
    """Users may not set -fno-threadsafe-statics: no guard of a static may be asked for either."""
    made = tmp_path / "made.o"
    macro = f'-D{name.upper()}_LINK_DMA_MEMORY=__attribute__((section(".dma")))'
    source = str(generated / f"{name}_link.cpp")
    run([*CPP_COMPILERS[compiler], *CPP, "-Os", macro, f"-I{generated}", "-c", source, "-o", str(made)])
    tools = "arm-none-eabi-" if compiler.startswith("cortex") else ""
    symbols = run([f"{tools}nm", "--undefined-only", "--format=just-symbols", str(made)]).split()
    known = ("__aeabi_", "__gnu_thumb1_", "_GLOBAL_OFFSET_TABLE_")
    memory = {"memcpy", "memset", "memmove", "memchr", "memcmp", "bcmp"}
    assert [symbol for symbol in symbols if symbol not in memory and not symbol.startswith(known)] == []
    sections = run([f"{tools}objdump", "--section-headers", str(made)])
    assert ".init_array" not in sections
    assert " .dma " in sections


def test_a_size_that_cannot_be_says_what_to_set(generated: Path) -> None:
    wrong = {
        "NATIVE_LINK_COUNT": (0, "to the number of this firmware's links"),
        "NATIVE_LINK_RECEIVE_BYTES": (100, "to a power of two"),
        "NATIVE_LINK_SEND_BYTES": (64, "to a power of two, at least twice 55"),
        "NATIVE_LINK_SEND_FRAMES": (1, "to a power of two"),
    }
    macros = [f"-D{macro}={value}" for macro, (value, _) in wrong.items()]
    command = ["g++", *CPP, "-fsyntax-only", *macros, f"-I{generated}", str(generated / "native_link.cpp")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert [
        f"set {macro} {told}" for macro, (_, told) in wrong.items() if f"set {macro} {told}" not in done.stderr
    ] == []


MORE_AWKWARD = """\
  link: {id: 8, sender: mcu, every: 1 s, fields: {count: {type: u8, enum: {a: 0}}, open: {type: u8, enum: {b: 1}}}}
  link_handlers: {id: 9, sender: both, every: 1 s, fields: {gap: {type: padding, size: 3}}}
deadlines:
  - {message: t, at: mcu, after: 3 s, then: velocity}
  - {message: t, at: mcu, after: 4 s, then: fill}
  - {message: t, at: mcu, after: 5 s, then: link_state}
"""


def test_names_that_are_hard_on_a_link_do_not_meet(tmp_path: Path) -> None:
    """A message and an action of one name, messages that are called as parts of the link, actions as its own words."""
    before, _, after = AWKWARD.partition("deadlines: [")
    rest = after.partition("\n")[2]
    generate_c(loads(before + MORE_AWKWARD + rest), tmp_path)
    header = tmp_path / "string_link.h"
    run(["gcc", "-std=c99", *STRICT, "-fsyntax-only", "-x", "c", f"-I{tmp_path}", str(header)])
    source = str(tmp_path / "string_link.cpp")
    run(["g++", *CPP, *QUICK, f"-I{tmp_path}", "-c", source, "-o", str(tmp_path / "made.o")])
    text = header.read_text(encoding="utf-8")
    assert "typedef struct string_link_2 string_link_2_t;" in text
    assert "(*on_velocity)(void* context, const string_velocity_t* message);" in text
    assert "(*on_velocity_2)(void* context);" in text
    assert "string_send_link_handlers(string_link_2_t* link);" in text
    assert "STRING_LINK_COUNT_A" in (tmp_path / "string_protocol.h").read_text(encoding="utf-8")


IGNORED = """
#include "diffdrive_link.h"
void report(diffdrive_link_t* link, const diffdrive_status_t* status) {{
  uint8_t frame[DIFFDRIVE_STATUS_MAX_FRAME_BYTES];
  size_t size = 0;
  diffdrive_status_t read;
  {statement}
  diffdrive_link_poll(link, (uint32_t)(frame[0] + read.errors + size));
}}
"""


@pytest.mark.parametrize("compiler", ["gcc", "clang-14"])
@pytest.mark.parametrize(
    "call",
    [
        "diffdrive_send_status(link, status)",
        "diffdrive_encode_status(status, frame, sizeof frame, &size)",
        "diffdrive_decode_status(frame, size, &read)",
    ],
)
def test_an_answer_that_no_program_awaits_is_reported(
    compiler: str, call: str, generated: Path, tmp_path: Path
) -> None:
    """docs/c.md says so, and what to write."""

    def said(statement: str) -> str:
        source = tmp_path / "ignored.c"
        source.write_text(IGNORED.format(statement=statement))
        command = [
            compiler,
            "-std=c99",
            "-Wall",
            f"-I{generated}",
            "-c",
            str(source),
            "-o",
            str(tmp_path / "ignored.o"),
        ]
        return subprocess.run(command, capture_output=True, text=True, check=True).stderr

    assert "unused-result" in said(f"{call};")
    assert ("unused-result" in said(f"(void){call};")) == (compiler == "gcc")
    good = "WIREBOND_OK" if "decode" not in call else "true"
    assert "unused-result" not in said(f"if ({call} != {good}) {{ /* why */ }}")


COUNTED = """
wirebond: 1
protocol: counted
frame: [magic: 0xAA, id: u8, payload: by_id, check: xor8]
messages:
  counts: {id: 1, sender: mcu, every: 100 ms, fields: {no_start: {type: u8}, sent: {type: u8}, own: {type: u8}}}
  go: {id: 2, sender: host}
services: {counters: {message: counts}}
"""


def test_a_link_in_c_sends_its_counters_with_and_without_a_handler(tmp_path: Path) -> None:
    generate_c(loads(COUNTED), tmp_path)
    objects = []
    for name in ("counted", "counted_link"):
        objects.append(str(tmp_path / f"{name}.o"))
        run([CXX, *CPP, *QUICK, f"-I{tmp_path}", "-c", str(tmp_path / f"{name}.cpp"), "-o", objects[-1]])
    program, built = PROGRAM.with_name("c_counters_test.c"), str(tmp_path / "program")
    run([CC, "-std=c99", *STRICT, f"-I{tmp_path}", str(program), *objects, "-o", built])
    # Every 100 ms; the noise came at 50 ms. From 250 ms on a handler has a field of its own, and at 400 ms it says no.
    assert run([built]).split("\n") == ["0 0 0", "3 1 0", "3 2 0", "3 3 7", ""]
