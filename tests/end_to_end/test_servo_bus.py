"""Two servos on one bus, each a process of firmware/servo: commands for one do not move the other, whoever gives them.

What one of them sends is heard by the host and by the other servo, as on one pair of wires.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

import wirebond
from tests.compilers import CXX
from tests.shared import PROTOCOLS, ROOT, codec
from tests.waiting import PATIENCE, moments, wait_until
from wirebond.generate.code import generate_cpp
from wirebond.sim.bus import Bus
from wirebond.sim.process import FirmwareProcess

pytestmark = pytest.mark.live

FILE = PROTOCOLS / "servo_bus.yaml"
FIRMWARE = ROOT / "firmware"
FLAGS = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-Wshadow", "-Wconversion", "-O0", "-pthread"]
COMMAND = Path(sys.executable).with_name("wirebond")


@dataclass(frozen=True)
class Programs:
    servo: Path
    master: Path


@dataclass(frozen=True)
class Line:
    """The bus with servos 3 and 7."""

    servos: dict[int, FirmwareProcess]
    port: str

    def wait_for(self, servo: int, event: str) -> None:
        wait_until(
            lambda: any(line.partition(" ")[2] == event for line in self.servos[servo].events(timeout=0.2)),
            f"servo {servo} reports: {event}",
        )


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Programs:
    folder = tmp_path_factory.mktemp("servo")
    generate_cpp(wirebond.load(FILE).model, folder)
    includes = [folder, FIRMWARE, FIRMWARE / "servo", ROOT / "ports" / "posix" / "include"]
    for name in ("main", "master"):
        source = FIRMWARE / "servo" / "host" / f"{name}.cpp"
        command = [CXX, *FLAGS, *(f"-I{include}" for include in includes), str(source), "-o", str(folder / name)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    return Programs(folder / "main", folder / "master")


@pytest.fixture
def line(programs: Programs) -> Iterator[Line]:
    with (
        FirmwareProcess(programs.servo, "servo 3", "3") as three,
        FirmwareProcess(programs.servo, "servo 7", "7") as seven,
        Bus([three.port, seven.port]) as bus,
    ):
        found = Line({3: three, 7: seven}, bus.port)
        for servo in found.servos:
            found.wait_for(servo, "released")
        yield found


def send(line: Line, *words: str) -> str:
    """Return the output of `wirebond send`. If the machine is too slow for an answer within a second, it is sent
    again."""
    command = [str(COMMAND), "send", str(FILE), line.port, *words]
    for _ in moments("an answer"):
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
        if done.returncode == 0:
            return done.stdout
    raise AssertionError


def test_the_command_line_turns_one_servo_and_is_answered_by_it(line: Line) -> None:
    send(line, "move", "angle=0.5", "time=0", "--header", "servo=3")
    line.wait_for(3, "turns to 0.500")
    pose = json.loads(send(line, "read", "--header", "servo=3"))
    assert (pose["message"], pose["fields"]) == ("pose", {"angle": 0.5})
    assert pose["header"]["servo"] == 3
    assert not any("turns" in event for event in line.servos[7].events())


@pytest.mark.parametrize(
    ("servo", "sentence", "code"),
    [
        (0xFE, "read was sent to servo 254, the broadcast, which is not answered", 0),
        (9, "read was sent to servo 9; no pose came back within 1 s; nothing arrived in that time", 1),
    ],
)
def test_the_command_line_says_whose_answer_does_not_come(line: Line, servo: int, sentence: str, code: int) -> None:
    command = [str(COMMAND), "send", str(FILE), line.port, "read", "--header", f"servo={servo}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert (done.returncode, done.stdout) == (code, "")
    assert sentence in " ".join(done.stderr.split())


def ask(link: wirebond.Link, servo: int) -> wirebond.Message:
    """The servo's pose, asked again where the line or the servo was busy."""
    for _ in moments(f"an answer of servo {servo}"):
        link.send("read", header={"servo": servo})
        for message in link.receive(1.0):
            if message.name == "pose" and message.header["servo"] == servo:
                return message
    raise AssertionError


def test_python_turns_both_and_a_broadcast_is_acted_on_by_all_and_answered_by_none(line: Line) -> None:
    with wirebond.open(codec("servo_bus"), line.port) as link:
        for servo, angle in ((3, 0.5), (7, -0.25)):
            link.send("move", angle=angle, time=0.0, header={"servo": servo})
            line.wait_for(servo, f"turns to {angle:.3f}")
        assert [ask(link, servo).fields["angle"] for servo in (3, 7)] == pytest.approx([0.5, -0.25])

        link.send("move", angle=1.0, time=0.0, header={"servo": 0xFE})
        for servo in line.servos:
            line.wait_for(servo, "turns to 1.000")
        for servo in (0xFE, 9):  # all of them, and one that is not there
            link.send("read", header={"servo": servo})
            link.send("ping", number=1, header={"servo": servo})
        assert link.receive(0.5) == []
        link.send("ping", number=2, header={"servo": 7})
        pongs: list[wirebond.Message] = []
        wait_until(lambda: pongs or pongs.extend(m for m in link.receive(0.5) if m.name == "pong"), "a pong")
        assert [(m.fields["number"], m.header["servo"]) for m in pongs] == [(2, 7)]
        assert link.stats.receive.discarded_bytes == dict.fromkeys(link.stats.receive.discarded_bytes, 0)


def test_commands_for_the_other_do_not_keep_a_servo_from_giving_way(line: Line) -> None:
    with wirebond.open(codec("servo_bus"), line.port) as link:
        for servo in (3, 7):
            link.send("move", angle=0.1, time=0.0, header={"servo": servo})
            line.wait_for(servo, "turns to 0.100")
        for _ in moments("servo 3 gives way"):
            if any("released" in event for event in line.servos[3].events(timeout=0.05)):
                break
            link.send("move", angle=0.1, time=0.0, header={"servo": 7})
        assert "released" in ask(link, 3).header["state"]
        # A machine may be too slow for two seconds between a command and the answer behind it.
        for _ in moments("servo 7 holds its angle"):
            link.send("move", angle=0.1, time=0.0, header={"servo": 7})
            if "released" not in ask(link, 7).header["state"]:
                break


def test_a_host_in_cpp_turns_both_and_says_which_one_does_not_answer(line: Line, programs: Programs) -> None:
    command = [str(programs.master), line.port, "3=0.5", "7=-0.25", "9=1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.stdout.splitlines() == [
        "servo 3 is at 0.500 rad",
        "servo 7 is at -0.250 rad",
        "servo 9 does not answer, or does not turn",
    ]
    assert done.returncode == 1


def test_a_number_that_no_servo_has_is_reported(programs: Programs) -> None:
    for number in ("0", "254", "three", ""):
        done = subprocess.run(
            [str(programs.servo), number], capture_output=True, text=True, timeout=PATIENCE, check=False
        )
        assert done.returncode == 2
        assert "a number from 1 to 253" in done.stderr
