"""Generated headers compile without a warning wherever they are meant to, and do what they say."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.compilers import CXX, SANITIZE
from tests.shared import codec

from wirebond.generate.code import generate_c, generate_cpp
from wirebond.generate.code.cpp import stop_functions
from wirebond.generate.code.cpp_names import struct_names
from wirebond.generate.code.names import namespace
from wirebond.protocol import loads
from wirebond.protocol.model import End, Protocol

pytestmark = pytest.mark.live

Shell = Callable[[list[str]], str]

HERE = Path(__file__).parent
FIRMWARE = ["-fno-exceptions", "-fno-rtti"]
ARM = ["arm-none-eabi-g++", "-mthumb", "-fno-threadsafe-statics"]
COMPILERS = {
    "gcc": ["g++"],
    "clang": ["clang++-14"],
    "cortex-m4": [*ARM, "-mcpu=cortex-m4", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"],
    "cortex-m3": [*ARM, "-mcpu=cortex-m3"],
    "cortex-m0": [*ARM, "-mcpu=cortex-m0"],
}
# `make test` compiles every header with one compiler, and with the others those that hold every kind of field;
# `make prove` all with all, with both ways to optimise.
EVERY_KIND = ("native", "log", "shapes")
SHORT = {
    ("clang", "-Os"),
    ("cortex-m4", "-O0"),
    ("cortex-m4", "-Og"),
    ("cortex-m4", "-O2"),
    ("cortex-m3", "-Os"),
    ("cortex-m0", "-Os"),
}
MATRIX = [
    pytest.param("gcc", "-O2", None),
    *(pytest.param(target, optimise, EVERY_KIND) for target, optimise in sorted(SHORT)),
]
MATRIX += [
    pytest.param(target, optimise, None, marks=pytest.mark.long)
    for target in COMPILERS
    for optimise in ("-O2", "-Os")
    if (target, optimise) != ("gcc", "-O2")
]


def use_of(protocol: Protocol) -> str:
    """A source that instantiates all of a protocol's header: both receivers, every encode, deadlines, the stop."""
    space = namespace(protocol.name)
    lines = [
        f'#include "{protocol.name}.hpp"',
        f"namespace use_{protocol.name} {{",
        "struct Handler : wirebond::ServesBothEnds {",
    ]
    lines += [f"  void on(const {space}::{struct}&) {{ ++calls; }}" for struct in struct_names(protocol).values()]
    actions = dict.fromkeys(deadline.then for deadline in protocol.deadlines)
    lines += [f"  void {action}() {{ ++calls; }}" for action in actions]
    lines += ["  void unknown(const wirebond::Frame&) { ++calls; }", "  int calls = 0;", "};", "Handler handler;"]
    for source in ("FromHost", "FromMcu"):
        lines += [
            f"{space}::Receiver<{space}::{source}> receiver_{source};",
            f"void receive_{source}(const std::uint8_t* bytes, std::size_t size, std::uint32_t now_us) {{",
            f"  receiver_{source}.feed(bytes, size, now_us, handler);",
            f"  receiver_{source}.idle(now_us, handler);",
            "}",
        ]
    for struct in struct_names(protocol).values():
        lines += [
            f"wirebond::Status send_{struct}(const {space}::{struct}& message, std::uint8_t* out,",
            "    std::size_t& size) {",
            f"  return {space}::encode(message, out, {space}::{struct}::Info::max_frame_bytes, size);",
            "}",
        ]
    for end in (End.HOST, End.MCU):
        if any(deadline.at in (end, End.BOTH) for deadline in protocol.deadlines):
            lines += [
                f"wirebond::Deadlines<{space}::{end}_deadlines.size()> deadlines_{end}({space}::{end}_deadlines, 0u);",
                f"void poll_{end}(std::uint32_t now_us) {{",
                f"  deadlines_{end}.poll(now_us, [](std::uint8_t action) {{",
                f"    {space}::act_at_{end}(action, handler);",
                "  });",
                "}",
            ]
    for function in stop_functions(protocol):
        lines.append(f"auto stop_by_{function}() {{ return {space}::{function}(); }}")
    return "\n".join([*lines, "}", ""])


@pytest.mark.parametrize(("target", "optimise", "names"), MATRIX)
def test_headers_compile_without_a_warning(
    target: str,
    optimise: str,
    names: tuple[str, ...] | None,
    protocols: list[Protocol],
    generated: Path,
    strict: list[str],
    shell: Shell,
    tmp_path: Path,
) -> None:
    source = tmp_path / "use.cpp"
    chosen = [protocol for protocol in protocols if names is None or protocol.name in names]
    assert len(chosen) == len(names or protocols)
    source.write_text("".join(use_of(protocol) for protocol in chosen), encoding="utf-8")
    command = [*COMPILERS[target], *strict, *FIRMWARE, optimise, f"-I{generated}"]
    shell([*command, "-c", str(source), "-o", str(tmp_path / "use.o")])


LEVELS = ("-O0", "-Og", "-O1", "-Os", "-O2", "-O3")
NO_FIELDS = """
wirebond: 1
protocol: no_fields
frame:
  - cobs: [{id: u8}, {payload: rest}, {check: crc-16/ibm-sdlc}]
  - delimiter: 0x00
messages:
  go: {id: 1, sender: host, reply: gone}
  gone: {id: 2, sender: mcu, queue: urgent}
  alive: {id: 3, sender: mcu, every: 10 ms, queue: latest}
"""


@pytest.mark.parametrize(
    "optimise", [level if level in ("-O0", "-O2") else pytest.param(level, marks=pytest.mark.long) for level in LEVELS]
)
def test_messages_without_fields_compile_without_a_warning_at_every_level(
    optimise: str, strict: list[str], shell: Shell, tmp_path: Path
) -> None:
    protocol = loads(NO_FIELDS)
    generate_cpp(protocol, tmp_path / "cpp")
    generate_c(protocol, tmp_path / "c")
    source = tmp_path / "cpp" / "use.cpp"
    source.write_text(use_of(protocol) + '#include "no_fields_link.hpp"\n', encoding="utf-8")
    for path in (source, *(tmp_path / "c").glob("*.cpp")):
        command = [*COMPILERS["cortex-m4"], *strict, *FIRMWARE, optimise, f"-I{path.parent}"]
        shell([*command, "-c", str(path), "-o", str(tmp_path / "use.o")])


@pytest.mark.parametrize(
    ("name", "optimise"),
    [
        pytest.param(name, level, marks=() if (name, level) == ("diffdrive", "-O1") else pytest.mark.long)
        for name in ("diffdrive", "enterprize", "pid_tuner", "native", "servo_bus")
        for level in LEVELS
    ],
)
def test_links_in_c_compile_without_a_warning_at_every_level(
    name: str, optimise: str, strict: list[str], shell: Shell, tmp_path: Path
) -> None:
    generate_c(codec(name).model, tmp_path)
    for path in tmp_path.glob("*.cpp"):
        command = [*COMPILERS["cortex-m4"], *strict, *FIRMWARE, optimise, f"-I{tmp_path}"]
        shell([*command, "-c", str(path), "-o", str(tmp_path / "use.o")])


@pytest.mark.parametrize("name", ["diffdrive", pytest.param("enterprize", marks=pytest.mark.long), "pid_tuner"])
def test_float_fields_pull_in_no_double_arithmetic(
    name: str, protocols: list[Protocol], generated: Path, shell: Shell, tmp_path: Path
) -> None:
    """The M4 has no double unit: each double operation would be a call of a library function."""
    source = tmp_path / "use.cpp"
    source.write_text(use_of(next(p for p in protocols if p.name == name)), encoding="utf-8")
    made = tmp_path / "use.o"
    flags = ["-std=c++17", "-O2", *FIRMWARE, f"-I{generated}"]
    shell([*COMPILERS["cortex-m4"], *flags, "-c", str(source), "-o", str(made)])
    undefined = shell(["arm-none-eabi-nm", "--undefined-only", str(made)]).split()
    assert [symbol for symbol in undefined if symbol.startswith("__aeabi_")] == []


def test_generated_code_does_what_it_says(generated: Path, strict: list[str], shell: Shell, tmp_path: Path) -> None:
    program = tmp_path / "generated_test"
    calls = ["-DWIREBOND_INLINE=inline", "-DWIREBOND_INLINE_LAMBDA="]  # else each of their checks is there often
    source = str(HERE / "generated_test.cpp")
    shell([CXX, *strict, "-O0", *SANITIZE, *calls, f"-I{generated}", source, "-o", str(program)])
    shell([str(program)])


def test_fast_math_takes_no_refusal_away(generated: Path, shell: Shell, tmp_path: Path) -> None:
    """Firmware is often compiled with -ffast-math, which lets a compiler take every float for finite."""
    source = tmp_path / "nan.cpp"
    source.write_text(
        """
        #include "diffdrive.hpp"
        #include "enterprize.hpp"
        int main(int count, char**) {
          const std::uint32_t bits = 0x7FC00000u + static_cast<unsigned>(count) - 1u;
          float nan;
          std::memcpy(&nan, &bits, sizeof nan);
          std::uint8_t out[64];
          std::size_t size = 0;
          const bool sent = encode(diffdrive::Velocity{nan, 0.0F}, out, sizeof out, size) == wirebond::Status::ok ||
                            encode(enterprize::ChassisCmd{0, 0, nan}, out, sizeof out, size) == wirebond::Status::ok;
          return sent ? 1 : 0;
        }
        """,
        encoding="utf-8",
    )
    program = tmp_path / "nan"
    shell(["g++", "-std=c++17", "-O3", "-ffast-math", f"-I{generated}", str(source), "-o", str(program)])
    shell([str(program)])


def test_folder_builds_as_a_subdirectory_of_a_cmake_project(
    protocols: list[Protocol], shell: Shell, tmp_path: Path
) -> None:
    generate_cpp(next(p for p in protocols if p.name == "diffdrive"), tmp_path / "link")
    (tmp_path / "main.cpp").write_text(
        '#include "diffdrive.hpp"\nint main() { return diffdrive::baud == 115200 ? 0 : 1; }\n'
    )
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(rover CXX)\nadd_subdirectory(link)\n"
        "add_executable(rover main.cpp)\ntarget_link_libraries(rover PRIVATE wirebond_diffdrive)\n"
    )
    shell(["cmake", "-S", str(tmp_path), "-B", str(tmp_path / "build")])
    shell(["cmake", "--build", str(tmp_path / "build")])
    shell([str(tmp_path / "build" / "rover")])
