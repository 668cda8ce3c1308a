"""The generated C API makes the vectors' bytes and reads them back, from C and without a C++ library."""

from __future__ import annotations

import dataclasses
import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import wirebond
from tests.compilers import CC, CXX, SANITIZE_FOR_C
from tests.shared import PROTOCOLS, ROOT, VECTORS
from tests.test_device_checks import FORMATS, FRAMES
from wirebond.generate.code import generate_c
from wirebond.generate.code.c_names import member_name
from wirebond.generate.code.cpp_number import integer, real, real_type
from wirebond.generate.doc.examples import example_values
from wirebond.protocol.loader import loads
from wirebond.protocol.model import Field
from wirebond.protocol.names import identifier

pytestmark = pytest.mark.live

SHAPES = ROOT / "tests" / "generate" / "code" / "every_shape.yaml"
TYPES = ROOT / "tests" / "generate" / "code" / "every_type.yaml"
STRICT = ["-Wall", "-Wextra", "-Werror", "-pedantic"]
CPP = ["-std=c++17", "-fno-exceptions", "-fno-rtti", *STRICT]
QUICK = ["-O0", "-DWIREBOND_INLINE=inline", "-DWIREBOND_INLINE_LAMBDA="]  # to compile; what is tested is what it does
M4 = ["-mthumb", "-mcpu=cortex-m4", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]
M0 = ["-mthumb", "-mcpu=cortex-m0"]
C_COMPILERS = {
    "gcc-c99": ["gcc", "-std=c99"],
    "gcc-c11": ["gcc", "-std=c11"],
    "gcc-cpp": ["g++", "-x", "c++", "-std=c++17"],
    "clang-c99": ["clang-14", "-std=c99"],
    "clang-cpp": ["clang++-14", "-x", "c++", "-std=c++17"],
    "cortex-m4": ["arm-none-eabi-gcc", "-std=c99", *M4],
    "cortex-m0": ["arm-none-eabi-gcc", "-std=c99", *M0],
}
LONG = pytest.mark.long


def run(command: list[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(command)}\nends with {done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One folder with the C API of all protocols."""
    folder = tmp_path_factory.mktemp("c")
    for path in [*PROTOCOLS.glob("*.yaml"), SHAPES, TYPES]:
        generate_c(wirebond.load(path).model, folder)
    return folder


# ---- it compiles ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("compiler", C_COMPILERS)
def test_header_is_plain_c_everywhere(compiler: str, generated: Path, tmp_path: Path) -> None:
    """All protocols in one file: their names do not meet, and the standard headers are not hidden by `log.h`."""
    source = tmp_path / "use.c"
    headers = sorted(path.name for path in generated.glob("*.h"))
    assert len(headers) >= 7
    lines = [*(f'#include "{name}"' for name in headers), "#include <math.h>", "extern int nothing;"]
    source.write_text("\n".join([*lines, ""]), encoding="utf-8")
    run([*C_COMPILERS[compiler], *STRICT, f"-I{generated}", "-c", str(source), "-o", str(tmp_path / "use.o")])


CPP_COMPILERS = {
    "gcc": ["g++", "-Wconversion", "-Wshadow"],
    "clang": ["clang++-14", "-Wconversion", "-Wshadow"],
    "cortex-m4": ["arm-none-eabi-g++", *M4],
    "cortex-m0": ["arm-none-eabi-g++", *M0],
}


# On this machine the tests below compile the sources anyway; the two ARMs lay structs out alike.
@pytest.mark.parametrize(
    "compiler", ["cortex-m0", *(pytest.param(c, marks=LONG) for c in ("gcc", "clang", "cortex-m4"))]
)
def test_structs_of_both_languages_lie_alike_on_every_processor(compiler: str, generated: Path) -> None:
    """It is asserted in the sources, as is the room for receivers; an assertion needs no machine code."""
    sources = sorted(map(str, generated.glob("*.cpp")))
    assert len(sources) >= 7
    run([*CPP_COMPILERS[compiler], *CPP, "-fsyntax-only", f"-I{generated}", *sources])


@pytest.mark.long
@pytest.mark.parametrize("optimise", ["-O2", "-Os"])
@pytest.mark.parametrize("name", ["enterprize", "pid_tuner", "native", "shapes", "log"])
@pytest.mark.parametrize("compiler", CPP_COMPILERS)
def test_source_compiles_without_a_warning_and_asks_for_no_cpp_library(
    compiler: str, name: str, optimise: str, generated: Path, tmp_path: Path
) -> None:
    made = tmp_path / "made.o"
    command = [*CPP_COMPILERS[compiler], *CPP, optimise]
    run([*command, f"-I{generated}", "-c", str(generated / f"{name}.cpp"), "-o", str(made)])
    nm = "arm-none-eabi-nm" if compiler.startswith("cortex") else "nm"
    symbols = run([nm, "--undefined-only", "--format=just-symbols", str(made)]).split()
    known = ("__aeabi_", "__gnu_thumb1_", "_GLOBAL_OFFSET_TABLE_")
    memory = {"memcpy", "memset", "memmove", "memchr", "memcmp"}
    assert [symbol for symbol in symbols if symbol not in memory and not symbol.startswith(known)] == []


AWKWARD = """
wirebond: 1
protocol: string
frame: [magic: 0xAA, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
types:
  message: {restrict: {type: u8}}
messages:
  t: {id: 1, sender: host, fields: {restrict: {type: u8, enum: {typeof: 1}}, context: {type: u32, flags: {x: 31}}}}
  encode: {id: 2, sender: host, fields: {size: {type: u64, enum: {big: 18446744073709551615}}, y: {struct: message}}}
  from_host: {id: 3, sender: mcu, fields: {a_b: {type: u8, enum: {c: 1}}, message: {struct: message}}}
  from_host_a: {id: 4, sender: mcu, fields: {b: {type: u8, enum: {c: 1}}}}
  from_host_handlers: {id: 5, sender: both, fields: {gap: {type: padding, size: 3}}}
  mcu_deadlines: {id: 6, sender: both, fields: {empty: {struct: {gap: {type: padding, size: 2}}}}}
  velocity: {id: 7, sender: host, fields: {id: {type: u8, enum: {index: 0}}, every: {type: u8, enum: {us: 0}}}}
deadlines: [{message: t, at: mcu, after: 1 s, then: context}, {message: t, at: mcu, after: 2 s, then: unknown}]
emergency_stop: [{message: from_host_handlers}, {message: mcu_deadlines}]
"""


def test_names_that_are_hard_on_c_do_not_meet(tmp_path: Path) -> None:
    """`string.h` would hide the system's, `restrict` is a word of C alone, and C has one scope for all names."""
    generate_c(loads(AWKWARD), tmp_path)
    assert not (tmp_path / "string.h").exists()
    header = tmp_path / "string_protocol.h"
    run(["gcc", "-std=c99", *STRICT, "-fsyntax-only", "-x", "c", f"-I{tmp_path}", str(header)])
    run(["g++", *CPP, "-fsyntax-only", f"-I{tmp_path}", str(tmp_path / "string_protocol.cpp")])
    text = header.read_text(encoding="utf-8")
    assert "uint8_t restrict_;" in text
    assert "#define STRING_ENCODE_SIZE_BIG ((uint64_t)18446744073709551615ULL)" in text
    assert "STRING_FROM_HOST_A_B_C = 1" in text and "STRING_FROM_HOST_A_B_C_2 = 1" in text
    assert "string_from_host_t;" in text and "string_from_host_2_t;" in text


# ---- it works ---------------------------------------------------------------------------------------------------


def leaves(fields: tuple[Field, ...], values: dict[str, Any], to: str) -> Iterator[tuple[str, str]]:
    """Every plain value below ``values``: where it lies in the C struct ``to``, and its literal."""
    for field in fields:
        if not field.has_value or field.is_count or field.constant is not None:
            continue
        value, place = values[field.name], f"{to}{member_name(identifier(field.name))}"
        if field.is_string:
            data = value.encode() if isinstance(value, str) else value
            if field.is_variable:
                yield f"{place}.size", str(len(data))
                place += ".data"
            else:
                data = data.ljust(field.size, b"\0")
            yield from ((f"{place}[{i}]", str(byte)) for i, byte in enumerate(data))
        elif field.is_list or field.count is not None:
            if field.is_list:
                yield f"{place}.size", str(len(value))
                place += ".data"
            for i, one in enumerate(value):
                yield from _leaf(field, one, f"{place}[{i}]")
        else:
            yield from _leaf(field, value, place)


def _leaf(field: Field, value: Any, place: str) -> Iterator[tuple[str, str]]:
    if field.fields:
        yield from leaves(field.fields, value, place + ".")
    elif field.value_type is bool:
        yield place, "true" if value else "false"
    elif field.enum:
        yield place, integer(dict(field.enum)[value] if isinstance(value, str) else value)
    elif field.flags and isinstance(value, list):
        yield place, f"{sum(1 << dict(field.flags)[name] for name in value)}U"
    elif field.is_float or field.is_scaled:
        yield place, real(value, real_type(field))
    else:
        yield place, integer(value)


@dataclasses.dataclass(frozen=True)
class Case:
    message: str
    sender: str
    values: dict[str, Any]
    frame: bytes
    header: dict[str, int] = dataclasses.field(default_factory=dict)  # where it differs from the defaults


def cases(codec: wirebond.Codec) -> list[Case]:
    """Those of the vectors, what devices publish, and one more of each message, made by the engine."""
    path = VECTORS / f"{codec.name}.json"
    rows = json.loads(path.read_text()) if path.exists() else []
    found = [Case(row["message"], row["sender"], row["fields"], bytes.fromhex(row["hex"])) for row in rows]
    found += [
        Case(message, sender, values, bytes.fromhex(frame), header)
        for file, sender, frame, message, values, header in FRAMES
        if file == codec.name
    ]
    for message in codec.model.messages:
        values = example_values(message)
        sender = "mcu" if message.sender == "mcu" else "host"
        found.append(Case(message.name, sender, values, codec.encode(message.name, values)))
    return found


def program(codec: wirebond.Codec) -> str:
    """C that encodes each case, compares the bytes, and takes them byte by byte through a receiver to its handler."""
    name = codec.name
    lines = [
        f'#include "{name}.h"',
        "#include <math.h>",
        "#include <stdio.h>",
        "#include <string.h>",
        "static int calls, failures;",
        "static void expect(bool held, const char* what) { if (!held) { ++failures; puts(what); } }",
        "#define SAME(got, wanted) (fabs((double)(got) - (wanted)) <= 1e-6 * fabs(wanted))",
    ]
    all_cases, ends_by_silence = cases(codec), codec.model.format.ends_by_silence
    for i, case in enumerate(all_cases):
        message, sender, values, frame = case.message, case.sender, case.values, case.frame
        fields = codec.model.message(message).fields
        has_struct = any(field.has_value for field in fields)
        struct, encode = f"{name}_{message}_t", f"{name}_encode_{message}"
        receiver = f"{name}_from_{sender}"
        parameter = f", const {struct}* got" if has_struct else ""
        suffix = "_with_header" if case.header else ""
        if case.header:
            parameter += f", const {name}_header_t* header"
        lines.append(f"static void got_{i}(void* context{parameter}) {{")
        lines.append("  ++*(int*)context;")
        for place, literal in leaves(fields, values, "got->") if has_struct else ():
            check = f"SAME({place}, {literal})" if "." in literal else f"{place} == {literal}"
            lines.append(f'  expect({check}, "{message}: {place}");')
        lines += [f'  expect(header->{key} == {value}, "{message}: {key}");' for key, value in case.header.items()]
        lines += ["}", f"static void case_{i}(void) {{"]
        lines.append(f"  static const uint8_t wanted[] = {{{', '.join(map(str, frame))}}};")
        lines.append(f"  uint8_t out[{name.upper()}_{message.upper()}_MAX_FRAME_BYTES];")
        lines.append("  size_t size = 0, at;")
        if has_struct:
            lines += [f"  {struct} message;", f"  {name}_init_{message}(&message);"]
            lines += [f"  {place} = {literal};" for place, literal in leaves(fields, values, "message.")]
            lines.append(f'  expect({name}_violations_{message}(&message) == 0, "{message}: violations");')
        argument = "&message, " if has_struct else ""
        if case.header:
            encode += suffix
            argument += "&header, "
            lines += [f"  {name}_header_t header;", f"  {name}_init_header(&header);"]
            lines += [f"  header.{key} = {value};" for key, value in case.header.items()]
        lines += [
            f'  expect({encode}({argument}out, sizeof out, &size) == WIREBOND_OK, "{message}: encode");',
            f'  expect(size == sizeof wanted && memcmp(out, wanted, size) == 0, "{message}: bytes");',
            f'  expect({encode}({argument}out, sizeof wanted - 1, &size) == WIREBOND_TOO_SMALL, "{message}: room");',
            f'  expect(size == 0, "{message}: size");',
            f"  static {receiver}_t receiver;",
            f"  {receiver}_handlers_t handlers = {{0}};",
            "  calls = 0;",
            "  handlers.context = &calls;",
            f"  handlers.on_{message}{suffix} = got_{i};",
            f"  {receiver}_init(&receiver, &handlers);",
            f"  for (at = 0; at < sizeof wanted; ++at) {receiver}_feed(&receiver, wanted + at, 1, 1000);",
            *([f"  {receiver}_idle(&receiver, 1000 + 2 * {name.upper()}_IDLE_US);"] if ends_by_silence else []),
            f'  expect(calls == 1, "{message}: calls");',
            f"  const wirebond_account_t account = {receiver}_account(&receiver);",
            f'  expect(account.frames == 1 && account.frame_bytes == sizeof wanted, "{message}: account");',
            f'  expect({receiver}_violations(&receiver).rejected == 0, "{message}: violations received");',
            "}",
        ]
    calls = [f"  case_{i}();" for i in range(len(all_cases))]
    return "\n".join(
        [*lines, "int main(void) {", *calls, '  printf("%d\\n", failures);', "  return failures;", "}", ""]
    )


@pytest.mark.parametrize(
    "path",
    [
        *(PROTOCOLS / f"{name}.yaml" for name in ("diffdrive", "enterprize", "pid_tuner", "native")),
        SHAPES,
        *(pytest.param(FORMATS / f"{name}.yaml", marks=LONG) for name in dict.fromkeys(row[0] for row in FRAMES)),
        pytest.param(TYPES, marks=LONG),
    ],
    ids=lambda path: path.stem,
)
@pytest.mark.parametrize(
    "sanitize", [pytest.param([], id="plain"), pytest.param(SANITIZE_FOR_C, id="sanitized", marks=LONG)]
)
def test_every_vector_goes_through_c(path: Path, sanitize: list[str], generated: Path, tmp_path: Path) -> None:
    codec = wirebond.load(path)
    if path.parent == FORMATS:
        generate_c(codec.model, generated)
    source, made, built = tmp_path / "main.c", tmp_path / "api.o", tmp_path / "program"
    source.write_text(program(codec), encoding="utf-8")
    run([CXX, *CPP, *QUICK, *sanitize, f"-I{generated}", "-c", str(generated / f"{codec.name}.cpp"), "-o", str(made)])
    run([CC, "-std=c99", *STRICT, *sanitize, f"-I{generated}", str(source), str(made), "-o", str(built)])
    assert run([str(built)]) == "0\n"


def test_folder_builds_as_a_subdirectory_of_a_c_project(tmp_path: Path) -> None:
    generate_c(wirebond.load(PROTOCOLS / "pid_tuner.yaml").model, tmp_path / "link")
    (tmp_path / "main.c").write_text(
        '#include "pid_tuner.h"\n'
        "int main(void) { pid_tuner_pid_t pid; pid_tuner_init_pid(&pid); return pid.p == 0.0F ? 0 : 1; }\n"
    )
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(bot C CXX)\nadd_subdirectory(link)\n"
        "add_executable(bot main.c)\ntarget_link_libraries(bot PRIVATE wirebond_pid_tuner)\n"
    )
    flags = f"-DCMAKE_CXX_FLAGS={' '.join(QUICK)}"
    run(["cmake", "-S", str(tmp_path), "-B", str(tmp_path / "build"), flags])
    run(["cmake", "--build", str(tmp_path / "build")])
    run([str(tmp_path / "build" / "bot")])


@pytest.mark.long
def test_a_request_decides_which_reply_is_meant(tmp_path: Path) -> None:
    codec = wirebond.load(ROOT / "tests" / "formats" / "by_request.yaml")
    model = codec.model
    generate_c(model, tmp_path)
    replies = [m for m in model.messages if m.reply is not None]
    lines = [f'#include "{codec.name}.h"', "static void count(void* context) { ++*(int*)context; }"]
    body: list[str] = []
    for i, request in enumerate(replies):
        reply = model.message(str(request.reply))
        index = f"{codec.name.upper()}_{request.name.upper()}_INDEX"
        has_struct = any(field.has_value for field in reply.fields)
        parameter = f", const {codec.name}_{reply.name}_t* message" if has_struct else ""
        use = "(void)message; " if has_struct else ""
        lines.append(f"static void got_{i}(void* context{parameter}) {{ {use}count(context); }}")
        frame = codec.encode(reply.name, example_values(reply))
        body += [
            "  {",
            f"    static const uint8_t bytes[] = {{{', '.join(map(str, frame))}}};",
            f"    static {codec.name}_from_mcu_t receiver;",
            "    int calls = 0;",
            f"    {codec.name}_from_mcu_handlers_t handlers = {{0}};",
            "    handlers.context = &calls;",
            f"    handlers.on_{reply.name} = got_{i};",
            f"    {codec.name}_from_mcu_init(&receiver, &handlers);",
            f"    if (!{codec.name}_from_mcu_expect(&receiver, {index})) return 1;",
            f"    {codec.name}_from_mcu_feed(&receiver, bytes, sizeof bytes, 0);",
            f"    {codec.name}_from_mcu_idle(&receiver, 2 * {codec.name.upper()}_IDLE_US);",
            "    if (calls != 1) return 2;",
            f"    if ({codec.name}_from_mcu_expect(&receiver, -1)) return 3;",
            "  }",
        ]
    assert replies
    (tmp_path / "main.c").write_text("\n".join([*lines, "int main(void) {", *body, "  return 0;", "}", ""]))
    made, built = tmp_path / "api.o", tmp_path / "program"
    run([CXX, *CPP, *QUICK, f"-I{tmp_path}", "-c", str(tmp_path / f"{codec.name}.cpp"), "-o", str(made)])
    run([CC, "-std=c99", *STRICT, str(tmp_path / "main.c"), str(made), "-o", str(built)])
    run([str(built)])
