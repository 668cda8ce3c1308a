"""The MCU's end of sequence numbers, over generated code: raised in the order of the wire, and counted exactly."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest
from tests.compilers import SANITIZE
from tests.mcu_link.test_link_at_mcu import CALLS
from tests.shared import ROOT

from wirebond.generate.code import generate_cpp
from wirebond.protocol import loads

pytestmark = pytest.mark.live

HERE = ROOT / "tests" / "mcu_link"
FLAGS = ["-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]
FRAMES = {
    "plain": "[magic: 0xA5, length: u16, sequence: u8, id: u8, payload: by_length, check: crc-16/modbus]",
    "cobs": "[delimiter: 0x00, cobs: [id: u8, {sequence: u16, per: message}, payload: rest, check: crc-16/modbus], "
    "delimiter: 0x00]",
    "escaped": "[{delimiter: 0x7E}, hdlc: [id: u8, sequence: u8, payload: rest, check: crc-16/ibm-sdlc], "
    "{delimiter: 0x7E}]",
}
TEXT = """
wirebond: 1
protocol: {name}
link: {{baud: 921600, max_age: 50 ms}}
frame: {frame}
messages:
  report:
    id: 1
    sender: mcu
    fields: {{number: {{type: u32}}, level: {{type: f32, range: [0, 100]}}, data: {{type: bytes, max: 280}}}}
  alarm: {{id: 2, sender: mcu, queue: urgent, fields: {{number: {{type: u32}}}}}}
  newest: {{id: 3, sender: mcu, queue: latest, fields: {{number: {{type: u32}}}}}}
  command: {{id: 4, sender: host, fields: {{number: {{type: u32}}}}}}
"""


def build(folder: Path, *options: str) -> str:
    for name, frame in FRAMES.items():
        generate_cpp(loads(TEXT.format(name=name, frame=frame)), folder)
    sources = [str(HERE / "numbered" / "numbers_test.cpp"), str(ROOT / "core" / "tests" / "main.cpp")]
    program = str(folder / "numbers_test")
    _run(["clang++-14", *FLAGS, *options, f"-I{folder}", f"-I{HERE}", *sources, "-o", program])
    return program


def test_numbers_rise_in_the_order_of_the_wire_and_gaps_are_exact(tmp_path: Path) -> None:
    _run([build(tmp_path, *SANITIZE, *CALLS), "--no-version"])


@pytest.mark.long
def test_gaps_are_exact_in_a_million_frames(tmp_path: Path) -> None:
    _run([build(tmp_path, "-O2"), "--no-version", "--test-case=gaps*"], {"WIREBOND_LONG": "1"})


def _run(command: list[str], more: dict[str, str] | None = None) -> None:
    result = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **(more or {})})
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-4000:]
