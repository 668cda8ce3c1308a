"""Names that C and C++ have already: each is refused in a sentence, or generated code calls it otherwise."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from wirebond import ProtocolFileError
from wirebond.generate.code import generate_c, generate_cpp
from wirebond.protocol import loads

pytestmark = pytest.mark.live

Shell = Callable[[list[str]], str]

LONG = pytest.mark.long

C_HEADERS = (
    "complex", "math", "signal", "stdbool", "stdint", "stdio", "stdlib", "stdnoreturn", "string", "tgmath", "threads",
    "time", "unistd",
)  # fmt: skip
CPP_HEADERS = ("cmath", "complex", "csignal", "cstdio", "cstdlib", "ctime", "unistd.h")
GNU_WORDS = ("typeof", "typeof_unqual", "asm", "i386", "linux", "unix", "mips", "sparc")
OF_OTHER_PROCESSORS = ("-Di386=1", "-Dmips=1", "-Dsparc=1")  # what GNU compilers for them define by themselves


def protocol_text(protocol: str, messages: tuple[str, ...], fields: tuple[str, ...]) -> str:
    lines = ["wirebond: 1", f"protocol: {protocol}", "frame:", "  - magic: 0xA5", "  - id: u8", "  - payload: by_id"]
    lines += ["  - check: crc-16/mcrf4xx", "messages:"]
    members = ", ".join(f"{name}: {{type: u8}}" for name in fields)
    lines += [f"  {name}: {{id: {n}, sender: both, fields: {{{members}}}}}" for n, name in enumerate(messages)]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("protocol", "messages", "fields"),
    [
        ("p", ("mcu_buffers", "host_buffers", "mcu_link", "at_mcu"), ("v",)),
        ("p", ("size", "size_t"), ("size", "size_t")),
        pytest.param("p", ("size_t", "size"), ("v",), marks=LONG),
        ("p", ("link_t", "link", "m_t", "m", "handlers_t", "link_handlers"), ("v",)),
        ("p", GNU_WORDS, GNU_WORDS),
        ("p", ("m",), ("complex", "imaginary", "noreturn", "i", "restrict")),
        pytest.param("uint8_t", ("m",), ("v",), marks=LONG),
        *(pytest.param(protocol, ("m",), ("v",), marks=LONG) for protocol in ("main", "complex", "size_t", "time_t")),
    ],
)
def test_taken_names_compile_beside_the_standard_headers(
    protocol: str, messages: tuple[str, ...], fields: tuple[str, ...], shell: Shell, tmp_path: Path
) -> None:
    model = loads(protocol_text(protocol, messages, fields))
    generate_cpp(model, tmp_path / "cpp")
    generate_c(model, tmp_path / "c")
    warnings = ["-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
    in_c = "".join(f"#include <{name}.h>\n" for name in C_HEADERS)
    in_cpp = [word for name in CPP_HEADERS for word in ("-include", name)]
    for header in (tmp_path / "c").glob("*.h"):
        use = tmp_path / "use.c"
        use.write_text(f'{in_c}#include "{header.name}"\nint use(void) {{ return 0; }}\n')
        shell(["gcc", "-std=gnu11", *OF_OTHER_PROCESSORS, *warnings, f"-I{header.parent}", str(use)])
    for path in (*(tmp_path / "c").glob("*.cpp"), *(tmp_path / "cpp").glob("*.hpp")):
        source = tmp_path / "use.cpp"  # a header that is compiled by itself warns of its pragma
        source.write_text(path.read_text() if path.suffix == ".cpp" else f'#include "{path.name}"\n')
        shell(["g++", "-std=gnu++17", *OF_OTHER_PROCESSORS, *warnings, *in_cpp, f"-I{path.parent}", str(source)])


@pytest.mark.parametrize("protocol", ["std", "wirebond", "int", "errno", *GNU_WORDS])
def test_names_that_nothing_else_can_take_are_refused(protocol: str) -> None:
    with pytest.raises(ProtocolFileError, match=f"`{protocol}` is .*write for example"):
        loads(protocol_text(protocol, ("m",), ("v",)))
