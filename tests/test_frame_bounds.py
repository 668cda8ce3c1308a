"""Memory and limits come from each end's own frames: long frames of one end cost the other one's receiver nothing."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests import reference
from tests.compilers import CC, CXX
from tests.shared import account_closes
from wirebond import Codec
from wirebond.analysis.explain import explain
from wirebond.generate.code import generate_c
from wirebond.link.settings import engine_settings
from wirebond.protocol import loads
from wirebond.protocol.model import End
from wirebond.protocol.planning import plan_for

pytestmark = pytest.mark.live

TEXT = """
wirebond: 1
protocol: uneven
frame: [magic: 0xA5, length: u16, id: u8, payload: by_length, check: crc-16/modbus]
messages:
  image: {id: 1, sender: mcu, fields: {data: {type: bytes, max: 2800}}}
  move:  {id: 2, sender: host, fields: {speed: {type: i16}}}
"""
CODEC = Codec(loads(TEXT))
COMMAND = str(Path(sys.executable).with_name("wirebond"))
LONG, SHORT = 2806, 8  # largest frames on the wire


def test_each_end_has_the_bound_of_its_own_frames() -> None:
    assert [plan_for(CODEC.model, end).max_payload for end in (End.HOST, End.MCU)] == [2, 2800]
    assert [CODEC.model.max_wire_bytes(sender=end) for end in (End.HOST, End.MCU, None)] == [SHORT, LONG, LONG]
    bounded = loads(TEXT.replace("frame:", "max_payload: 3000\nframe:"))
    assert [plan_for(bounded, end).max_payload for end in (End.HOST, End.MCU)] == [3000, 3000]


def test_a_length_beyond_the_senders_frames_is_a_false_start_at_once() -> None:
    false_start = bytes([0xA5, 100, 0, 2])
    good = CODEC.encode("move", speed=1)
    decoder = CODEC.decoder("host")
    assert [m.raw for m in decoder.feed(false_start + good)] == [good]
    assert decoder.stats.rejected_candidates["length_out_of_range"] == 1
    assert account_closes(decoder.stats)
    assert [f.wire for f in reference.decode(CODEC.model, false_start + good, End.HOST).frames] == [good]
    assert (
        explain(CODEC.model, false_start + good, End.HOST).stretches[0].summary == "length: expected 0 to 2, found 100"
    )
    assert CODEC.decoder("mcu").feed(CODEC.encode("image", data=bytes(100)))[0].name == "image"


PROGRAM = """
#include <stdio.h>
#include "uneven.h"
#include "uneven_link.h"
int main(void) {
  printf("%zu %zu\\n", sizeof(uneven_from_host_t), sizeof(uneven_from_mcu_t));
  return 0;
}
"""


def test_generated_c_reserves_for_what_it_receives(tmp_path: Path) -> None:
    generate_c(CODEC.model, tmp_path)
    (tmp_path / "main.c").write_text(PROGRAM)
    built = tmp_path / "main"
    subprocess.run([CC, "-std=c99", "-Wall", "-Werror", f"-I{tmp_path}", tmp_path / "main.c", "-o", built], check=True)
    at_mcu, at_host = map(int, subprocess.run([built], capture_output=True, text=True, check=True).stdout.split())
    assert abs(at_host - at_mcu - 2 * (LONG - SHORT)) < 8  # aligned
    subprocess.run(
        [CXX, "-std=c++17", "-O0", f"-I{tmp_path}", "-c", tmp_path / "uneven.cpp", "-o", tmp_path / "x.o"], check=True
    )  # it asserts that the object fits


@pytest.mark.parametrize(("end", "size"), [(End.HOST, SHORT), (End.MCU, LONG)])
def test_a_link_reserves_for_what_it_sends(end: End, size: int) -> None:
    assert engine_settings(CODEC, 115200, True, end=end).largest_frame == size


def test_check_shows_both(tmp_path: Path) -> None:
    file = tmp_path / "uneven.yaml"
    file.write_text(TEXT)
    done = subprocess.run([COMMAND, "check", file, "--json"], capture_output=True, text=True, check=False)
    assert json.loads(done.stdout)["figures"]["largest_frame"] == {
        "host": {"wire_bytes": SHORT, "workspace_bytes": 2 * SHORT},
        "mcu": {"wire_bytes": LONG, "workspace_bytes": 2 * LONG},
    }
