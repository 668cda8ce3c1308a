"""An emergency stop with arrays, groups, structs, texts and bits: every end sends its bytes, and recognises it."""

from __future__ import annotations

import json
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

import wirebond
from tests.command import run as command
from tests.compilers import CC, CXX, SANITIZE
from tests.patient_servers import ages, real_ages  # noqa: F401 - fixtures of this module
from tests.server.conftest import Served
from tests.server.test_clients import json_client
from tests.shared import ROOT
from tests.test_c_api import CPP, QUICK, STRICT, run
from tests.waiting import wait_until
from wirebond.cli.main import main
from wirebond.console.protocol_form import protocol_form
from wirebond.generate.code import generate_c, generate_cpp
from wirebond.protocol.loader import loads
from wirebond.protocol.model import End
from wirebond.recording.history.mcu_deadlines import McuDeadlines
from wirebond.recording.history.source import Source
from wirebond.ros2.commands import Commands
from wirebond.server import Server
from wirebond.sim.pty_port import PtyPort
from wirebond.sim.virtual_mcu import VirtualMcu

pytestmark = pytest.mark.live

FILE = ROOT / "tests" / "legs.yaml"
LEGS = wirebond.load(FILE)
JOINTS = {
    "mode": "hold",
    "joints": [
        {"position": 0.1, "speed": 0},
        {"position": -0.35, "speed": 0.0015},
        {"position": 0, "speed": -0.25, "enabled": False},
    ],
    "gains": [0, 5],
    "by": "stop",
}
GRIPPERS = {
    "grippers": [{"force": 41.1, "key": b"\x01\xff"}, {"force": 1e9, "key": b"\x02"}],
    "torques": [0.5, -1.25],
    "base": {"at": {"position": 2, "speed": 0}, "state": {"level": 5, "on": True}},
    "lights": ["right"],
    "heat": 21.7,
}
# Worked out from the file by hand.
JOINTS_PAYLOAD = struct.pack(
    "<BfhBfhBfhB2B4sB", 0, 0.1, 0, 1, -0.35, 2, 1, 0.0, -250, 0, 0, 5, b"stop", 0
)  # fmt: skip
GRIPPERS_PAYLOAD = (
    bytes([2])
    + (333).to_bytes(5, "little")
    + b"\x01\xff"
    + (8100005913).to_bytes(5, "little")
    + b"\x02\x00"
    + struct.pack("<hhfhBBBf", 4050, -10125, 2.0, 0, 1, 5 | 1 << 3, 8, 617.0)
)


def crc(data: bytes) -> bytes:
    register = 0xFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0xA001 if register & 1 else 0)
    return struct.pack("<H", register)


def frame(number: int, payload: bytes) -> bytes:
    whole = b"\xaa\x55" + bytes([number, len(payload)]) + payload
    return whole + crc(whole)


STOP = [frame(1, JOINTS_PAYLOAD), frame(2, GRIPPERS_PAYLOAD)]


def joints(**others: object) -> bytes:
    return LEGS.encode("joints", {**JOINTS, **others})


def grippers(**others: object) -> bytes:
    return LEGS.encode("grippers", {**GRIPPERS, **others})


def with_joint(index: int, **others: object) -> bytes:
    listed = [dict(one) for one in JOINTS["joints"]]  # type: ignore[call-overload]
    listed[index].update(others)
    return joints(joints=listed)


ARE_STOPS = [
    *STOP,
    joints(note=7),  # the file does not give it
    with_joint(0, speed=-0.0),
    with_joint(2, position=-0.0),
    frame(
        2, GRIPPERS_PAYLOAD[:-4] + struct.pack("<I", struct.unpack("<I", GRIPPERS_PAYLOAD[-4:])[0] + 1)
    ),  # as a float
]
ARE_NONE = [
    joints(mode="walk"),
    with_joint(1, position=-0.35001),
    with_joint(2, speed=-0.251),
    with_joint(0, enabled=False),  # it is given by its default
    joints(gains=[5, 0]),
    joints(by="go"),
    grippers(torques=[0.5, -1.2499]),
    grippers(grippers=[], torques=[]),
    grippers(grippers=[*GRIPPERS["grippers"], {"force": 0, "key": b""}], torques=[0.5, -1.25, 0]),  # type: ignore[misc]
    grippers(grippers=[{"force": 41.2, "key": b"\x01\xff"}, {"force": 1234.5, "key": b"\x02"}]),
    grippers(base={"at": {"position": 2, "speed": 0}, "state": {"level": 4, "on": True}}),
    grippers(lights=["left", "right"]),
    grippers(heat=21.8),
]


# ---- the host sends it ------------------------------------------------------------------------------------------


def test_the_frames_are_those_of_the_file() -> None:
    assert [joints(), grippers()] == STOP
    assert [stop.fields for stop in LEGS.model.emergency_stop] == [JOINTS, GRIPPERS]


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    pty = PtyPort()
    path = tmp_path / "server.sock"
    with wirebond.open(LEGS, pty.path) as link, Server(link, path) as server:
        yield Served(LEGS, pty, link, server, f"wirebond://{path}")
    pty.close()


def bytes_until(pty: PtyPort, wanted: list[bytes]) -> bytes:
    got = bytearray()

    def has_all() -> bool:
        got.extend(pty.read(0.01))
        return all(one in got for one in wanted)

    wait_until(has_all, "the stop leaves")
    return bytes(got)


def test_it_leaves_from_an_own_link(served: Served) -> None:
    served.link.emergency_stop()
    assert bytes_until(served.pty, STOP).startswith(b"".join(STOP))


def test_it_leaves_from_an_attached_link(served: Served) -> None:
    with served.attach() as link:
        link.emergency_stop()
        assert bytes_until(served.pty, STOP).startswith(b"".join(STOP))
        link.release_stop()


def test_it_leaves_from_the_command_line(served: Served) -> None:
    assert main(["stop", served.address]) == 0
    assert bytes_until(served.pty, STOP).startswith(b"".join(STOP))


@pytest.mark.parametrize("is_attached", [False, True], ids=["own", "attached"])
def test_a_lease_and_a_program_end_with_it(served: Served, is_attached: bool) -> None:
    walk = joints(mode="walk")
    if is_attached:
        with served.attach() as link:
            link.repeat("joints", {**JOINTS, "mode": "walk"}, hold=0.05)
            bytes_until(served.pty, [walk, STOP[0]])  # the lease
            link.send("joints", {**JOINTS, "mode": "walk"})
    else:
        served.link.repeat("joints", {**JOINTS, "mode": "walk"}, hold=0.05)
        bytes_until(served.pty, [walk, STOP[0]])
        served.link.send("joints", {**JOINTS, "mode": "walk"})
        served.link.close()
    assert bytes_until(served.pty, [walk, STOP[0]]).endswith(STOP[0])


def test_the_command_line_says_that_the_safe_value_follows_other_commands_than_a_stop(served: Served) -> None:
    values = [f"{name}={json.dumps(value)}" for name, value in JOINTS.items() if isinstance(value, list)]
    for mode, follows in (("hold", False), ("walk", True)):
        done = command("send", str(FILE), served.address, "joints", f"mode={mode}", "by=stop", *values)
        assert done.returncode == 0
        assert ("the safe value of joints follows" in done.stderr) == follows


def test_it_leaves_from_the_bridge_to_ros(served: Served) -> None:
    said: list[str] = []
    Commands(served.link, lambda _, text: said.append(text)).stop("the test wants it")
    assert bytes_until(served.pty, STOP) == b"".join(STOP)
    assert said == []


def test_a_page_sends_its_values_which_are_json(served: Served) -> None:
    history = Source(LEGS, End.HOST, 0.01).history
    form = json.loads(json.dumps(protocol_form(LEGS, history, "", "port", 9600)))
    with json_client(served) as page:
        for stop, one in zip(form["emergency_stop"], STOP, strict=True):
            assert page.ask(do="send", message=stop["message"], fields=stop["fields"]).get("ok", 1) is None
            bytes_until(served.pty, [one])
        by = form["deadlines"][0]["recover_by"]
        assert page.ask(do="send", message=by["message"], fields=by["fields"]).get("ok", 1) is None
        bytes_until(served.pty, [LEGS.encode("clear", codes=[7, 9], why="told")])
        wrong = {**form["emergency_stop"][1]["fields"], "grippers": [{"force": 1, "key": "0g"}]}
        answer = page.ask(do="send", message="grippers", fields=wrong)
        assert answer["text"] == "grippers: key is '0g'; expected bytes as hexadecimal digits"


# ---- what is refused --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("left_out", ["joints", "gains"])
def test_an_array_that_is_left_out_is_refused(served: Served, left_out: str) -> None:
    values = {name: value for name, value in JOINTS.items() if name != left_out}
    sentence = f"joints needs {left_out}, which has no default"
    with pytest.raises(wirebond.MessageError, match=sentence):
        served.link.send("joints", values)
    with served.attach() as link, pytest.raises(wirebond.MessageError, match=sentence):
        link.send("joints", values)


def test_a_list_that_is_left_out_is_refused_unless_it_has_a_default() -> None:
    with pytest.raises(wirebond.MessageError, match="grippers needs grippers, which has no default"):
        LEGS.encode("grippers", {name: value for name, value in GRIPPERS.items() if name != "grippers"})
    few = {**GRIPPERS, "grippers": []}
    del few["torques"]  # its default is []
    assert LEGS.encode("grippers", few) == LEGS.encode("grippers", {**few, "torques": []})


# ---- ends in Python recognise it --------------------------------------------------------------------------------


def held(mcu: VirtualMcu, data: bytes) -> bool:
    before = mcu.held_back
    mcu.feed(data, 0.1)
    return mcu.held_back > before


def test_a_virtual_mcu_recognises_it() -> None:
    for one in ARE_STOPS:
        assert not held(VirtualMcu(LEGS, start=0.0), one)
    for one in ARE_NONE:
        assert held(VirtualMcu(LEGS, start=0.0), one)


def test_the_simulator_moves_until_it_comes() -> None:
    mcu = VirtualMcu(LEGS, start=0.0)
    decoder = LEGS.decoder("mcu")

    def positions(start: float) -> set[float]:
        return {m["position"] for i in range(10) for m in decoder.feed(mcu.tick(start + 0.02 * i)) if m.name == "state"}

    mcu.feed(LEGS.encode("clear", codes=[7, 9], why="told"), 0.0)
    assert positions(0.0) == {0.0}
    mcu.feed(joints(mode="walk"), 0.2)
    assert len(positions(0.2)) > 1
    mcu.feed(STOP[0], 0.4)
    assert positions(0.4) == {0.0}


def test_a_list_ends_a_deadline_and_another_one_does_not() -> None:
    mcu = VirtualMcu(LEGS, start=0.0)
    for codes, why in (([7, 8], "told"), ([7, 9], "tol")):
        mcu.feed(LEGS.encode("clear", codes=codes, why=why), 0.1)
        assert held(mcu, joints(mode="walk"))
    assert mcu.events[-1].endswith("until clear comes with codes = [7, 9], why = told")
    mcu.feed(LEGS.encode("clear", codes=[7, 9], why="told"), 0.1)
    assert not held(mcu, joints(mode="walk"))
    watch = McuDeadlines(LEGS.model)
    [ended] = watch._ended_by("clear", {"codes": [7, 9], "why": "told"})
    assert ended.rule.then == "fold"


def test_a_python_mcu_recognises_it() -> None:
    pty = PtyPort()
    with wirebond.open(LEGS, pty.path, role="mcu") as mcu:
        for one in (*STOP, joints(note=7)):
            pty.write(one)
        wait_until(lambda: sum(mcu.stats.receive.messages.values()) == 3, "they come")
        assert mcu.stats.held_back == 0
        pty.write(joints(mode="walk"))
        wait_until(lambda: mcu.stats.held_back == 1, "another one is held back")
    pty.close()


# ---- ends in C++ and C ------------------------------------------------------------------------------------------

CPP_PROGRAM = """
#include <array>
#include <cstdio>
#include "legs.hpp"

struct Mcu {
  int acted = 0;
  template <class Message>
  void count(const Message&) { ++acted; }
  HANDLERS
};

template <class Message>
void print(const Message& message) {
  std::array<std::uint8_t, 256> frame;
  std::size_t size = 0;
  if (legs::encode(message, frame.data(), frame.size(), size) != wirebond::Status::ok) std::puts("refused");
  for (std::size_t i = 0; i < size; ++i) std::printf("%02x", frame[i]);
  std::puts("");
}

int main() {
  PRINTS
  unsigned size = 0;
  while (std::scanf("%u", &size) == 1) {
    Mcu mcu;
    legs::Receiver<legs::FromHost> receiver;
    wirebond::Deadlines<legs::mcu_deadlines.size()> deadlines(legs::mcu_deadlines, 0);
    for (unsigned i = 0; i < size; ++i) {
      unsigned byte = 0;
      if (std::scanf("%x", &byte) != 1) return 1;
      const auto one = static_cast<std::uint8_t>(byte);
      receiver.feed(&one, 1, 1000, mcu, deadlines);
    }
    std::puts(mcu.acted == 1 ? "acts" : "held");
  }
  return 0;
}
"""

C_PROGRAM = """
#include <stdio.h>
#include "legs.h"

static int acted;
static void on_joints(void* context, const legs_joints_t* message) { (void)context; (void)message; ++acted; }
static void on_grippers(void* context, const legs_grippers_t* message) { (void)context; (void)message; ++acted; }
static void nothing(void* context) { (void)context; }

static void print(const uint8_t* frame, size_t size) {
  for (size_t i = 0; i < size; ++i) printf("%02x", frame[i]);
  puts("");
}

int main(void) {
  uint8_t frame[256];
  size_t made = 0;
  legs_joints_t joints;
  legs_emergency_stop_joints(&joints);
  if (legs_encode_joints(&joints, frame, sizeof frame, &made) != WIREBOND_OK) puts("refused");
  print(frame, made);
  legs_grippers_t grippers;
  legs_emergency_stop_grippers(&grippers);
  if (legs_encode_grippers(&grippers, frame, sizeof frame, &made) != WIREBOND_OK) puts("refused");
  print(frame, made);
  unsigned size = 0;
  while (scanf("%u", &size) == 1) {
    static legs_from_host_t receiver;
    static legs_mcu_deadlines_t deadlines;
    legs_from_host_handlers_t handlers = {0};
    legs_mcu_actions_t actions = {0};
    handlers.on_joints = on_joints;
    handlers.on_grippers = on_grippers;
    actions.on_fold = nothing;
    actions.on_open_up = nothing;
    acted = 0;
    if (!legs_mcu_deadlines_init(&deadlines, &actions, 0)) return 1;
    legs_from_host_init(&receiver, &handlers);
    legs_from_host_watch(&receiver, &deadlines);
    for (unsigned i = 0; i < size; ++i) {
      unsigned byte = 0;
      if (scanf("%x", &byte) != 1) return 1;
      const uint8_t one = (uint8_t)byte;
      legs_from_host_feed(&receiver, &one, 1, 1000);
    }
    puts(acted == 1 ? "acts" : "held");
  }
  return 0;
}
"""


def cpp_program(stops: dict[str, str], folder: Path, compiler: str = CXX) -> Path:
    """:param stops: the function for each message of the stop, by the message's class."""
    source, program = folder / "main.cpp", folder / "program"
    handlers = "\n  ".join(f"void on(const legs::{name}& message) {{ count(message); }}" for name in stops)
    prints = "\n  ".join(f"print(legs::{function}());" for function in stops.values())
    source.write_text(CPP_PROGRAM.replace("HANDLERS", handlers).replace("PRINTS", prints))
    strict = [*CPP, "-Wconversion", "-Wshadow"]
    run([compiler, *strict, *QUICK, *SANITIZE, f"-I{folder}", str(source), "-o", str(program)])
    return program


def answers(program: Path, *frames: bytes) -> list[str]:
    given = " ".join(f"{len(one)} {one.hex(' ')}" for one in frames)
    return subprocess.run([str(program)], input=given, capture_output=True, text=True, check=True).stdout.split()


EXPECTED = [*(one.hex() for one in STOP), *["acts"] * len(ARE_STOPS), *["held"] * len(ARE_NONE)]


@pytest.mark.parametrize("compiler", ["g++", "clang++-14"])
def test_an_mcu_in_cpp_makes_it_and_recognises_it(compiler: str, tmp_path: Path) -> None:
    generate_cpp(LEGS.model, tmp_path)
    stops = {"Joints": "emergency_stop_joints", "Grippers": "emergency_stop_grippers"}
    program = cpp_program(stops, tmp_path, compiler)
    assert answers(program, *ARE_STOPS, *ARE_NONE) == EXPECTED


def test_an_mcu_in_c_makes_it_and_recognises_it(tmp_path: Path) -> None:
    generate_c(LEGS.model, tmp_path)
    source, program, api = tmp_path / "main.c", tmp_path / "program", tmp_path / "api.o"
    source.write_text(C_PROGRAM)
    run([CXX, *CPP, *QUICK, f"-I{tmp_path}", "-c", str(tmp_path / "legs.cpp"), "-o", str(api)])
    run([CC, "-std=c99", *STRICT, f"-I{tmp_path}", str(source), str(api), "-o", str(program)])
    assert answers(program, *ARE_STOPS, *ARE_NONE) == EXPECTED


# ---- a stop that gives no values --------------------------------------------------------------------------------

DEFAULTS = wirebond.Codec(
    loads("""
wirebond: 1
protocol: legs
frame: [magic: 0xAA 0x55, id: u8, length: u8, payload: by_length, check: crc-16/modbus]
messages:
  joints:
    id: 1
    sender: host
    fields: {speeds: {type: i16, count: 2, default: 0}, mode: {type: u8, enum: {hold: 0, walk: 1}, default: hold}}
deadlines: [{message: joints, at: mcu, after: 1 s, then: fold, recover: explicit, start: held}]
emergency_stop: {message: joints}
""")
)


def test_a_stop_that_gives_nothing_is_its_defaults_and_no_other_message(tmp_path: Path) -> None:
    stop, moves = DEFAULTS.encode("joints"), DEFAULTS.encode("joints", speeds=[0, 1])
    assert not held(VirtualMcu(DEFAULTS, start=0.0), stop)
    assert held(VirtualMcu(DEFAULTS, start=0.0), moves)
    generate_cpp(DEFAULTS.model, tmp_path)
    assert answers(cpp_program({"Joints": "emergency_stop"}, tmp_path), stop, moves) == [stop.hex(), "acts", "held"]
    pty = PtyPort()
    with wirebond.open(DEFAULTS, pty.path, role="mcu") as mcu:
        pty.write(stop)
        wait_until(lambda: mcu.stats.receive.messages.get("joints") == 1, "it comes")
        assert mcu.stats.held_back == 0
        pty.write(moves)
        wait_until(lambda: mcu.stats.held_back == 1, "another one is held back")
    pty.close()
