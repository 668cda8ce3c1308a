"""Names as a device's manual has them: the file keeps them, and generated code writes them by one rule."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

import wirebond
from tests.compilers import CC, CXX
from wirebond.cli.main import main
from wirebond.codec import Codec
from wirebond.errors import UsageError
from wirebond.generate.code import generate_c, generate_cpp, generate_python
from wirebond.protocol import ProtocolFileError, loads
from wirebond.protocol.names import code_name
from wirebond.sim.pty_port import PtyPort

TEXT = """
wirebond: 1
protocol: manual
frame: [magic: 0xA5, {field: ID, type: u8, default: 1}, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
types:
  PIDGains: {Kp: {type: u8}, class: {type: u8}}
messages:
  NAV_PVT:
    id: 1
    sender: both
    every: 50 ms
    fields:
      RPM:        {type: i16, scale: 0.5}
      MotorSpeed: {type: u8, enum: {NULL: 0, default: 1, EOF: 2, StandBy: 3}, default: StandBy}
      class:      {type: u8, flags: {TX: 0, register: 1}}
      lambda:     {struct: PIDGains}
      header:     {type: u8}
      sender:     {type: u8, default: 0}
      hold:       {type: u8, default: 0}
      id:         {type: u8}
      t:          {type: u8}
      message:    {type: u8}
      errno:      {bits: {type: u8, fields: {int: {type: u3}, None: {type: bool}}}}
  int: {id: 2, sender: host, reply: float}
  float: {id: 3, sender: mcu}
  true:
    id: 4
    sender: mcu
    fields: {uint8_t: {type: u8}, size: {type: u8}, octets: {type: bytes, size: size, max: 4}}
  false: {id: 5, sender: both, fields: {size_t: {type: u8}, int16_t: {type: i16, count: 2}, more: {type: i16}}}
deadlines: [{message: NAV_PVT, at: mcu, after: 1 s, then: Switch}, {message: NAV_PVT, at: mcu, after: 2 s, then: union}]
emergency_stop:
  - message: NAV_PVT
    RPM: 0
    class: 0
    id: 0
    t: 0
    fields: {message: 7, header: 0}
"""
VALUES: dict[str, Any] = {
    "RPM": 1.5,
    "MotorSpeed": "EOF",
    "class": ["TX", "register"],
    "lambda": {"Kp": 1, "class": 2},
    "header": 3,
    "sender": 4,
    "hold": 5,
    "id": 6,
    "t": 7,
    "message": 8,
    "errno": {"int": 5, "None": True},
}


def stopped_with_defaults() -> str:
    """A struct has no default, so the stop cannot name it: the stop's file has the message without it."""
    return TEXT.replace("      lambda:     {struct: PIDGains}\n", "").replace(
        "      errno:      {bits: {type: u8, fields: {int: {type: u3}, None: {type: bool}}}}\n", ""
    )


FULL = TEXT[: TEXT.index("emergency_stop")]


@pytest.mark.parametrize(
    ("name", "code"),
    [("wheel_speed", "wheel_speed"), ("MotorSpeed", "motor_speed"), ("RPM", "rpm"), ("I2C", "i2c"),
     ("MotorRPMLimit", "motor_rpm_limit"), ("NAV_PVT", "nav_pvt"), ("x_2", "x_2")],
)  # fmt: skip
def test_code_has_one_spelling(name: str, code: str) -> None:
    assert code_name(name) == code


def test_the_python_api_and_the_command_line_have_the_names_of_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    codec = Codec(loads(FULL))
    frame = codec.encode("NAV_PVT", VALUES, header={"ID": 9})
    [message] = codec.decoder("host").feed(frame)
    assert message.name == "NAV_PVT"
    assert message.fields == VALUES
    assert message.header == {"ID": 9}
    columns = codec.decode_columns(frame, "host")["NAV_PVT"]
    assert columns["RPM"].tolist() == [1.5]
    assert columns["lambda.class"].tolist() == [2]
    path = tmp_path / "manual.yaml"
    path.write_text(FULL)
    words = ["RPM=1.5", "MotorSpeed=EOF", "class=TX,register", "lambda.Kp=1", "lambda.class=2", "header=3", "sender=4",
             "hold=5", "id=6", "t=7", "message=8", 'errno={"int": 5, "None": true}']  # fmt: skip
    assert main(["encode", str(path), "NAV_PVT", *words]) == 0
    assert bytes.fromhex(capsys.readouterr().out) == codec.encode("NAV_PVT", VALUES)


def test_an_option_is_not_taken_for_the_field_of_its_name() -> None:
    codec = Codec(loads(FULL))
    without = {name: value for name, value in VALUES.items() if name not in ("sender", "header")}
    with pytest.raises(
        UsageError, match=r"sender is an option of encode\(\) and a field of NAV_PVT; give the field in"
    ):
        codec.encode("NAV_PVT", without, sender="mcu")
    with pytest.raises(UsageError, match="header is an option"):
        codec.encode("NAV_PVT", without, header={"ID": 2})
    assert codec.encode("NAV_PVT", VALUES, sender="mcu") == codec.encode("NAV_PVT", VALUES)


@pytest.mark.live
def test_a_lease_is_not_taken_for_the_field_of_its_name() -> None:
    with closing(PtyPort()) as port, wirebond.open(Codec(loads(FULL)), port.path) as link:
        given = {name: value for name, value in VALUES.items() if name != "hold"}
        with pytest.raises(UsageError, match=r"hold is an option of repeat\(\) and a field of NAV_PVT"):
            link.repeat("NAV_PVT", given, hold=1)
        link.repeat("NAV_PVT", VALUES, hold=1)


def test_an_emergency_stop_gives_every_field() -> None:
    model = loads(stopped_with_defaults())
    assert dict(model.emergency_stop[0].values)["message"] == 7
    with pytest.raises(
        ProtocolFileError, match=r"leaves `message` of `NAV_PVT` open; add for example `fields: \{message: 0\}`"
    ):
        loads(stopped_with_defaults().replace("fields: {message: 7, header: 0}", "fields: {header: 0}"))


def test_a_stops_single_value_header_is_that_of_the_messages_field() -> None:
    beside = stopped_with_defaults().replace("fields: {message: 7, header: 0}", "fields: {message: 7}\n    header: 3")
    [stop, *_] = loads(beside).emergency_stop
    assert dict(stop.values)["header"] == 3
    assert stop.header == ()
    without = beside.replace("    header: 3", "")
    with pytest.raises(
        ProtocolFileError, match=r"leaves `header` of `NAV_PVT` open; add for example `fields: \{header: 0\}`"
    ):
        loads(without)
    other = "wirebond: 1\nprotocol: o\nframe: [magic: 0xFF, {field: servo, type: u8, default: 1}, id: u8, payload: 1]\n"
    other += "messages: {halt: {id: 1, sender: host, fields: {now: {type: u8}}}}\n"
    with pytest.raises(
        ProtocolFileError, match=r"`halt` has no field `header`. Write for example `header: \{servo: 1\}`"
    ):
        loads(other + "emergency_stop: {message: halt, now: 1, header: 3}\n")


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("  int: {id: 2", "  Int: {id: 4, sender: host}\n  int: {id: 2", "`int` and `Int` both become `Int` in C++"),
        ("      id:  ", "      Rpm: {type: u8}\n      id:  ", "`Rpm` and `RPM` are both `rpm` in generated code"),
        ("StandBy: 3}", "stand_by: 3, StandBy: 4}", "`StandBy` and `stand_by` are both `stand_by`"),
        ("register: 1", "tx: 1", "`tx` and `TX` are both `tx`"),
        ("then: union", "then: switch", "`switch` and `Switch` are both `switch`"),
        ("type: u8, default: 1}", "type: u8, default: 1}, {field: Id, type: u8}", "`Id` and `ID` are both `id`"),
        ("None: {type: bool}", "INT: {type: bool}", "`INT` and `int` are both `int`"),
    ],
)
def test_names_that_meet_in_code_are_refused(old: str, new: str, sentence: str) -> None:
    assert old in FULL
    with pytest.raises(ProtocolFileError, match=sentence):
        loads(FULL.replace(old, new, 1))


def test_typed_modules_have_attributes_of_one_spelling(tmp_path: Path) -> None:
    path = tmp_path / "manual.yaml"
    path.write_text(FULL)
    (made,) = generate_python(wirebond.load(path).model, tmp_path)
    spec = importlib.util.spec_from_file_location("manual", made)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["manual"] = module
    try:
        spec.loader.exec_module(module)
    finally:
        del sys.modules["manual"]
    codec = Codec(loads(FULL))
    [received] = codec.decoder("host").feed(codec.encode("NAV_PVT", VALUES))
    typed = module.from_message(received)
    assert (typed.rpm, typed.class_, typed.lambda_.class_, typed.errno.none) == (1.5, 3, 2, True)
    assert typed.motor_speed is module.NavPvtMotorSpeed.EOF
    assert typed.values() | {"class": ["TX", "register"], "MotorSpeed": "EOF"} == VALUES
    assert codec.encode(typed.NAME, typed.values()) == codec.encode("NAV_PVT", VALUES)


MAIN = """
#include <cstdio>
#include <cstring>
#include <cerrno>
#include "manual_link.hpp"
struct Handler {
  void on(const manual::NavPvt& m) {
    const int speed = static_cast<int>(m.motor_speed);
    std::printf("%d %d %d %d\\n", static_cast<int>(m.rpm * 2), speed, m.class_, m.errno_.int_);
  }
  void on(const manual::Int&) {}
  void switch_() {}
  void union_() {}
};
int main() {
  Handler handler;
  manual::act_at_mcu(0, handler);
  manual::NavPvt m;
  m.rpm = 1.5F;
  m.motor_speed = manual::NavPvt::MotorSpeed::eof;
  m.class_ = manual::NavPvt::Class::tx | manual::NavPvt::Class::register_;
  m.lambda.kp = 1;
  m.lambda.class_ = 2;
  m.errno_.int_ = 5;
  m.errno_.none = true;
  handler.on(m);
  std::puts(manual::NavPvt::Info::name);
}
"""
C_MAIN = """
#include <complex.h>
#include <errno.h>
#include "manual.h"
int main(void) {
  manual_nav_pvt_t m;
  manual_init_nav_pvt(&m);
  m.rpm = 1.5F;
  m.motor_speed = MANUAL_NAV_PVT_MOTOR_SPEED_EOF;
  m.class_ = MANUAL_NAV_PVT_CLASS_TX | MANUAL_NAV_PVT_CLASS_REGISTER;
  m.lambda.class_ = 2;
  return m.rpm > 1.0F ? 0 : 1;
}
"""


def run(command: list[Any]) -> str:
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.live
def test_cpp_and_c_compile_with_them(tmp_path: Path) -> None:
    model = loads(FULL)
    strict = ["-Wall", "-Wextra", "-Werror", "-O0", "-DWIREBOND_INLINE=inline", "-DWIREBOND_INLINE_LAMBDA="]
    generate_cpp(model, tmp_path)
    (tmp_path / "main.cpp").write_text(MAIN)
    run([CXX, "-std=c++17", *strict, "-I", tmp_path, tmp_path / "main.cpp", "-o", tmp_path / "main"])
    assert run([tmp_path / "main"]).splitlines() == ["3 2 3 5", "NAV_PVT"]
    generate_c(model, tmp_path)
    (tmp_path / "main.c").write_text(C_MAIN)
    for name in ("manual.cpp", "manual_link.cpp"):
        run(
            [
                CXX,
                "-std=c++17",
                "-fno-exceptions",
                "-fno-rtti",
                *strict,
                "-I",
                tmp_path,
                "-c",
                tmp_path / name,
                "-o",
                tmp_path / f"{name}.o",
            ]
        )
    run([CC, "-std=c99", "-pedantic", *strict, "-I", tmp_path, tmp_path / "main.c", tmp_path / "manual.cpp.o",
         "-o", tmp_path / "main_c"])  # fmt: skip
    run([tmp_path / "main_c"])


def test_a_field_without_a_value_may_be_called_like_an_option() -> None:
    frame = "frame: [magic: 0xA5, payload: rest, delimiter: 0x0A]\n"
    messages = "messages: {m: {sender: host, fields: {sender: {type: padding, size: 1}}}}\n"
    text = f"wirebond: 1\nprotocol: p\n{frame}{messages}"
    assert Codec(loads(text)).encode("m", sender="host") == bytes.fromhex("A5 00 0A")


TAKEN = """
wirebond: 1
protocol: taken
frame: [magic: {host: 0xA5, mcu: 0xA6}, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
messages:
"""
# Names of template parameters and of types of the generated link; those of services that the file does not have.
TAKEN_NAMES = (
    "handler", "source", "counter", "scheduled", "latest", "sends", "receives", "port", "memory", "hello", "ping",
    "clock", "log", "parameter",
)  # fmt: skip
TAKEN_MAIN = """
#include "taken_link.hpp"
struct Mine {
  void on(const taken::Handler& message) { sum += message.x; }
  unsigned sum = 0;
};
int main() {
  std::uint8_t frame[taken::Source::Info::max_frame_bytes];
  std::size_t size = 0;
  taken::Source source;
  if (taken::encode<taken::FromMcu>(source, frame, sizeof frame, size) != wirebond::Status::ok) return 1;
  Mine mine;
  taken::Receiver<taken::FromHost> receiver;
  receiver.feed(frame, size, 0, mine);
  return 0;
}
"""


@pytest.mark.live
def test_messages_may_be_called_as_what_generated_code_has(tmp_path: Path) -> None:
    messages = [
        f"  {name}: {{id: {number}, sender: both, every: 1 s, queue: latest, fields: {{x: {{type: u8}}}}}}"
        for number, name in enumerate(TAKEN_NAMES)
    ]
    model = loads(TAKEN + "\n".join(messages))
    generate_cpp(model, tmp_path)
    generate_c(model, tmp_path)
    (tmp_path / "main.cpp").write_text(TAKEN_MAIN)
    for name in ("main.cpp", "taken.cpp", "taken_link.cpp"):
        run(
            [
                CXX,
                "-std=c++17",
                "-O0",
                "-Wall",
                "-Wextra",
                "-Werror",
                "-fsyntax-only",
                "-I",
                tmp_path,
                tmp_path / name,
            ]
        )
