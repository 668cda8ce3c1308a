"""``clock_offset_us`` and ``bad_line_lost``: the MCU's link on a simulated UART with DMA.

How wrong the offset of the MCU's clock is that a host finds from one exchange, the worst of 2000: the MCU polls every
10 ms, and its port has a clock. And how many frames are lost that came whole, on a line with an error in one of 100
bytes: framing, noise, overrun. Both in virtual time, so that they repeat exactly.
"""

from __future__ import annotations

import json
import subprocess

from bench.figures import ROOT, Figure
from bench.native import build

COMMAND = "make bench ONLY=mcu_line"


def measure() -> list[Figure]:
    folders = ROOT / "ports" / "fake" / "include", ROOT / "tests" / "mcu_link" / "fake"
    program = build("mcu_line", ROOT / "protocols" / "native.yaml", *folders)
    told = json.loads(subprocess.run([str(program)], capture_output=True, text=True, check=True).stdout)
    return [
        Figure("clock_offset_us", told["clock_offset_us"], "us", 20, COMMAND),
        Figure("clock_offset_without_clock_us", told["clock_offset_without_clock_us"], "us", None, COMMAND),
        Figure("bad_line_lost", told["bad_line_lost"], "frames", 0, COMMAND),
        Figure("bad_line_frames", told["bad_line_frames"], "frames", None, COMMAND),
        Figure("bad_line_restarts", told["bad_line_restarts"], "restarts", 0, COMMAND),
    ]
