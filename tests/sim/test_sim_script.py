"""Scripts that say how a virtual MCU behaves: what they add, and what their mistakes look like."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.shared import PROTOCOLS, codec

from wirebond.cli.main import main
from wirebond.errors import UsageError
from wirebond.sim.script import Behaviour
from wirebond.sim.virtual_mcu import VirtualMcu

DIFFDRIVE = codec("diffdrive")
ROVER = """
def setup(mcu):
    state = {"linear": 0.0}

    @mcu.on("velocity")
    def velocity(message):
        state["linear"] = message["linear"]

    @mcu.fill("odometry")
    def odometry(t):
        return {"left_ticks": round(100 * state["linear"])}

    @mcu.on("status_query")
    def status(message):
        return {"battery": 11.1}

    @mcu.every(2.0)
    def tick(t):
        mcu.send("status", battery=9.9, errors=["low_battery"])
        mcu.report(f"low at {t:g} s")
"""


def virtual_mcu(tmp_path: Path, script: str) -> VirtualMcu:
    path = tmp_path / "behaviour.py"
    path.write_text(script)
    return VirtualMcu(DIFFDRIVE, 0.0, behaviour=Behaviour(DIFFDRIVE, path))


def messages(data: bytes, name: str) -> list[dict[str, Any]]:
    return [dict(m.fields) for m in DIFFDRIVE.decoder("mcu").feed(data) if m.name == name]


def test_a_script_fills_messages_answers_requests_and_sends_in_its_rhythm(tmp_path: Path) -> None:
    mcu = virtual_mcu(tmp_path, ROVER)
    mcu.feed(DIFFDRIVE.encode("velocity", linear=1.5, angular=0), 0.01)
    assert [m["left_ticks"] for m in messages(mcu.tick(0.06), "odometry")] == [150]
    (answer,) = messages(mcu.feed(DIFFDRIVE.encode("status_query"), 0.07), "status")
    assert answer["battery"] == pytest.approx(11.1)
    assert messages(mcu.tick(1.99), "status") == []
    (sent,) = messages(mcu.tick(2.0), "status")
    assert sent["battery"] == pytest.approx(9.9)
    assert sent["errors"] == ["low_battery"]
    assert "low at 2 s" in mcu.events


def test_a_script_ends_a_deadline_whose_recover_is_explicit(tmp_path: Path) -> None:
    script = """
def setup(mcu):
    @mcu.on("velocity")
    def velocity(message):
        mcu.report(f"drives at {message['linear']:g}")

    @mcu.on("parameter")
    def parameter(message):
        if message["name"] == "clear_safe_mode":
            mcu.recover("safe_mode")
"""
    mcu = virtual_mcu(tmp_path, script)
    mcu.feed(DIFFDRIVE.encode("velocity", linear=1, angular=0), 0.0)
    mcu.tick(4.0)  # silence has struck
    mcu.feed(DIFFDRIVE.encode("velocity", linear=0.5, angular=0), 4.1)
    assert "drives at 0.5" not in mcu.events
    mcu.feed(DIFFDRIVE.encode("parameter", name="clear_safe_mode", value=0), 4.2)
    mcu.feed(DIFFDRIVE.encode("velocity", linear=0.25, angular=0), 4.3)
    assert "drives at 0.25" in mcu.events


@pytest.mark.parametrize(
    ("script", "sentence"),
    [
        ("x = 1", r"behaviour\.py: expected a function setup\(mcu\)"),
        ("def setup(mcu):\n    1 / 0", r"behaviour\.py:2: ZeroDivisionError: division by zero"),
        ("def setup(mcu)\n    pass", r"behaviour\.py:1: SyntaxError"),
        (
            "def setup(mcu):\n    mcu.on('odometry')",
            r"behaviour\.py:2: the host sends no message 'odometry'; it sends velocity, status_query, parameter",
        ),
        ("def setup(mcu):\n    mcu.fill('status')", r"behaviour\.py:2: status has no `every`, so it is never due"),
        ("def setup(mcu):\n    mcu.send('velocity')", r"behaviour\.py:2: the MCU sends no message 'velocity'"),
        (
            "def setup(mcu):\n    mcu.recover('x')",
            r"behaviour\.py:2: the MCU has no .*then: x`; it has safe_mode, stop",
        ),
        ("def setup(mcu):\n    raise SystemExit(3)", r"behaviour\.py:2: SystemExit: 3"),
        ("def setup(mcu):\n    mcu.every(0)", r"behaviour\.py:2: mcu\.every\(0\): expected seconds, more than 0"),
    ],
)
def test_a_mistake_is_a_sentence_with_its_line(script: str, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=sentence):
        virtual_mcu(tmp_path, script)


def test_a_mistake_in_a_function_is_reported_when_it_is_called(tmp_path: Path) -> None:
    mcu = virtual_mcu(tmp_path, "def setup(mcu):\n    @mcu.fill('odometry')\n    def f(t):\n        return nothing\n")
    with pytest.raises(UsageError, match=r"behaviour\.py:4: NameError: name 'nothing' is not defined"):
        mcu.tick(0.1)
    mcu = virtual_mcu(tmp_path, "def setup(mcu):\n    @mcu.every(1)\n    def f(t): mcu.send('status', battery=1e9)\n")
    with pytest.raises(UsageError, match=r"behaviour\.py: status\.battery"):
        mcu.tick(1.0)
    mcu = virtual_mcu(tmp_path, "def setup(mcu):\n    mcu.fill('odometry')(lambda t: 5)\n")
    with pytest.raises(UsageError, match=r"behaviour\.py:2: the function gave 5; expected a dict of values"):
        mcu.tick(0.1)


def test_a_script_that_is_not_there_or_a_folder_is_a_sentence(tmp_path: Path) -> None:
    for path, sentence in ((tmp_path / "none.py", "No such file"), (tmp_path, "Is a directory")):
        with pytest.raises(UsageError, match=f"cannot be read: {sentence}.*; name a Python file"):
            Behaviour(DIFFDRIVE, path)


def test_command_ends_with_the_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script = tmp_path / "behaviour.py"
    script.write_text("def setup(mcu):\n    mcu.on('nothing')\n")
    assert main(["sim", str(PROTOCOLS / "diffdrive.yaml"), "--script", str(script)]) == 2
    assert "behaviour.py:2: the host sends no message 'nothing'" in " ".join(capsys.readouterr().err.split())
