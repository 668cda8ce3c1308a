"""Structs of a C header as messages: the same bytes as a C compiler's, and a comment on what no header tells."""

from __future__ import annotations

import struct
import subprocess
from pathlib import Path

import pytest

from wirebond.codec import Codec
from wirebond.generate.from_header import import_header
from wirebond.protocol import Protocol, loads
from wirebond.protocol.model import TWOS_COMPLEMENT, End, Field, FieldKind
from wirebond.protocol.spelling import field_type

HEADER = """\
// Robot link
#ifndef ROBOT_H
#define ROBOT_H
#include <stdint.h>
#include <stdbool.h>
#define N_MOTORS 4
#define PACKED __attribute__((packed))
#ifdef __cplusplus
extern "C" {
#endif

enum msg_id { MSG_CHASSIS_CMD = 0x10, MSG_MOTOR_STATUS = 0x20 };
typedef enum { MODE_IDLE, MODE_RUN = 3, MODE_STOP } mode_e;
typedef enum PACKED { COLOR_RED, COLOR_BLUE = 7 } color_e;
enum unused { FIRST = -1, SECOND };

typedef struct {
    float x;      // m/s, forwards
    double y;     /* m/s */
    uint16_t flags;
    bool on;
} PACKED ChassisCmd_t;

#pragma pack(push, 1)
struct pose { int16_t x, y; float heading; };
typedef struct motor_status {
    uint8_t id;
    struct pose pose;
    mode_e mode;
    int16_t speed[N_MOTORS];
    char name[8];
    uint8_t grid[2][N_MOTORS - 1];
    color_e color;
    unsigned long long serial;
} motor_status_t;
#pragma pack(pop)

#pragma pack(2)
struct two { uint8_t a; uint32_t b; };
#pragma pack()
struct loose { uint8_t a; uint32_t b; uint16_t c; struct { int8_t p; int64_t q; } inner[2]; uint8_t last; };
struct outer { uint8_t a; struct two t; } __attribute__((packed));
#ifdef __cplusplus
}
#endif
#endif
"""
STRUCTS = {  # name in C: message
    "ChassisCmd_t": "chassis_cmd",
    "struct motor_status": "motor_status",
    "struct loose": "loose",
    "struct outer": "outer",
}


def imported(tmp_path: Path, text: str = HEADER) -> tuple[str, Protocol]:
    header = tmp_path / "robot.h"
    header.write_text(text)
    found = import_header(header, "robot").text
    return found, loads(found)


@pytest.mark.live
def test_members_lie_where_a_c_compiler_puts_them(tmp_path: Path) -> None:
    """Offset and size of every member, and the size of the whole, from gcc."""
    _, protocol = imported(tmp_path)
    program = ['#include "robot.h"', "#include <stdio.h>", "#include <string.h>", "int main(void) {"]
    members = {
        "ChassisCmd_t": ["x", "y", "flags", "on"],
        "struct motor_status": [
            "id", "pose.x", "pose.y", "pose.heading", "mode", "speed", "name", "grid", "color", "serial",
        ],
        "struct loose": ["a", "b", "c", "inner[0].p", "inner[0].q", "inner[1].p", "inner[1].q", "last"],
        "struct outer": ["a", "t.a", "t.b"],
    }  # fmt: skip
    for c_name, names in members.items():
        program.append(f'  {{ {c_name} v; memset(&v, 0, sizeof v); printf("%zu", sizeof v);')
        program += [f'    printf(" %zu %zu", (size_t)((char*)&v.{m} - (char*)&v), sizeof v.{m});' for m in names]
        program.append('    printf("\\n"); }')
    program += ["  return 0;", "}"]
    (tmp_path / "main.c").write_text("\n".join(program))
    subprocess.run(["gcc", "-w", str(tmp_path / "main.c"), "-o", str(tmp_path / "main")], check=True)
    lines = subprocess.run([str(tmp_path / "main")], capture_output=True, text=True, check=True).stdout.splitlines()
    for c_name, line in zip(members, lines, strict=True):
        size, *numbers = map(int, line.split())
        message = protocol.message(STRUCTS[c_name])
        assert message.max_payload == size, c_name
        places, end = _places(message.fields, 0)
        assert end == size
        assert places == list(zip(numbers[::2], numbers[1::2], strict=True)), c_name


def _places(fields: tuple[Field, ...], at: int) -> tuple[list[tuple[int, int]], int]:
    """Offset and size of each member that is not a struct, in wire order; and the offset behind the last."""
    found = []
    for field in fields:
        if field.kind == FieldKind.STRUCT:
            for _ in range(field.count or 1):
                inner, at = _places(field.fields, at)
                found += inner
            continue
        if field.has_value:
            found.append((at, field.max_wire_bytes))
        at += field.max_wire_bytes
    return found, at


def test_types_arrays_enums_and_comments_come_along(tmp_path: Path) -> None:
    _, protocol = imported(tmp_path)
    command = protocol.message("chassis_cmd")
    assert [(f.name, field_type(f), f.description) for f in command.fields] == [
        ("x", "f32", "m/s, forwards"),
        ("y", "f64", "m/s"),
        ("flags", "u16", ""),
        ("on", "bool", ""),
    ]
    fields = {f.name: f for f in protocol.message("motor_status").fields}
    assert fields["mode"].enum == (("idle", 0), ("run", 3), ("stop", 4))
    assert (fields["mode"].size, fields["color"].size) == (4, 1)
    assert (fields["speed"].coding, fields["speed"].count) == (TWOS_COMPLEMENT, 4)
    assert (fields["grid"].count, fields["name"].kind, fields["name"].max_wire_bytes) == (6, FieldKind.TEXT, 8)
    assert list(fields)[:3] == ["id", "pose", "mode"]
    assert [(f.name, field_type(f)[0]) for f in fields["pose"].fields] == [
        ("x", "i"),
        ("y", "i"),
        ("heading", "f"),
    ]
    assert (fields["pose"].kind, fields["pose"].type_name) == (FieldKind.STRUCT, "pose")
    inner = next(f for f in protocol.message("loose").fields if f.name == "inner")
    assert (inner.count, [f.name for f in inner.fields]) == (2, ["p", "padding", "q"])


def test_ids_and_senders_are_taken_from_names_or_said_to_be_unknown(tmp_path: Path) -> None:
    text, protocol = imported(tmp_path)
    assert {m.name: (m.id, m.sender) for m in protocol.messages} == {
        "chassis_cmd": (0x10, End.HOST),
        "motor_status": (0x20, End.MCU),
        "loose": (0x01, End.HOST),
        "outer": (0x02, End.HOST),
    }
    assert "id: 0x10  # MSG_CHASSIS_CMD" in text
    assert "id: 0x01  # counted, not known" in text
    assert "sender: mcu  # a guess from its name" in text
    assert "sender: host  # not known: host or mcu" in text


def test_facts_that_the_header_lacks_are_listed(tmp_path: Path) -> None:
    text, _ = imported(tmp_path)
    head = text.split("wirebond: 1")[0]
    assert all(f"#   {word} " in head for word in ("frame", "id", "sender", "scale", "every"))
    assert "an enum takes 4 bytes here; with -fshort-enums it takes fewer" in text
    assert "The struct is not packed" in text
    assert "#   unused: {first: -1, second: 0}" in text
    assert "#   msg_id" not in text  # its values are the ids


def test_a_struct_within_another_is_no_message_of_its_own(tmp_path: Path) -> None:
    _, protocol = imported(tmp_path)
    assert "pose" not in [message.name for message in protocol.messages]


@pytest.mark.parametrize(
    ("member", "reason"),
    [
        ("uint8_t a : 3;", "a is a bit-field"),
        ("void *p;", "p is a pointer"),
        ("int (*f)(int);", "f is a pointer"),
        ("union { int i; float f; } u;", "u is a union"),
        ("struct unknown u;", "struct unknown, which is not defined here"),
        ("long double x;", "long double, which is not known here"),
        ("uint8_t rest[]; uint8_t more;", "rest has no size and is not its last member"),
        ("uint32_t rest[];", "rest is an array without a size"),
        ("uint8_t many[70000];", "many has 70000 elements"),
        ("uint8_t many[2 / 0];", "divided by zero"),
        ("uint8_t many[sizeof(int)];", "cannot calculate a size or value"),
    ],
)
def test_indescribable_members_are_left_out_with_a_reason(tmp_path: Path, member: str, reason: str) -> None:
    header = tmp_path / "x.h"
    header.write_text(f"#include <stdint.h>\nstruct bad {{ uint8_t first; {member} }};\nstruct good {{ int x; }};\n")
    found = import_header(header, "x")
    assert [m.name for m in loads(found.text).messages] == ["good"]
    assert len(found.notes) == 1
    assert found.notes[0].startswith("bad (line 2): ")
    assert reason in found.notes[0]
    assert f"# Left out: {found.notes[0]}." in found.text


def test_a_byte_array_without_a_size_takes_the_rest(tmp_path: Path) -> None:
    header = tmp_path / "x.h"
    header.write_text("typedef struct { unsigned char kind; char text[]; } line_t;\n")
    (message,) = loads(import_header(header, "x").text).messages
    assert message.fields[1].is_variable and message.fields[1].kind == FieldKind.TEXT


def test_names_that_a_protocol_file_cannot_have_are_changed(tmp_path: Path) -> None:
    header = tmp_path / "x.h"
    header.write_text("struct CLASS { int class, lambda, _x, X, HTTPServer; };\nstruct class_ { int a; };\n")
    first, second = loads(import_header(header, "x").text).messages
    assert [f.name for f in first.fields] == ["class", "lambda", "x", "x_2", "http_server"]
    assert {first.name, second.name} == {"class", "class_2"}


@pytest.mark.live
def test_the_compilers_own_preprocessor_gives_the_same(tmp_path: Path) -> None:
    header = tmp_path / "robot.h"
    header.write_text(HEADER)
    plain = tmp_path / "plain.h"
    output = subprocess.run(["gcc", "-E", "-P", str(header)], capture_output=True, text=True, check=True).stdout
    plain.write_text(output)
    own, theirs = (loads(import_header(path, "robot").text) for path in (header, plain))
    strip = [[(f.name, f.kind, f.size, f.count) for f in m.fields] for m in own.messages]
    assert strip == [[(f.name, f.kind, f.size, f.count) for f in m.fields] for m in theirs.messages]


def test_the_imported_file_encodes_as_the_struct_is_in_memory(tmp_path: Path) -> None:
    _, protocol = imported(tmp_path)
    codec = Codec(protocol)
    frame = codec.encode("outer", a=1, t={"a": 2, "b": 0x01020304})
    (message,) = codec.decoder("host").feed(frame)
    assert message.payload == struct.pack("<BBxI", 1, 2, 0x01020304)
