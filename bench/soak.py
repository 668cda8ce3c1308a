"""``soak_line_use_to_mcu`` and others: the overload experiment of `wirebond soak --virtual`, 90 minutes of it.

Goals: the line is full both ways although each run of the MCU's DMA costs a gap of 3 us, every frame lies in just one
bucket of the accounts, and the 90 minutes take less than 90 s. With bit errors no frame is lost that no error touched.
"""

from __future__ import annotations

import wirebond
from bench.collateral import PROTOCOL
from bench.figures import Figure
from wirebond.sim.soak import Settings, run

MINUTES = 90.0
LOAD = 1.2
BER = 1e-5
COMMAND = "make bench ONLY=soak"


def measure(minutes: float = MINUTES) -> list[Figure]:
    codec = wirebond.load(PROTOCOL)
    clean = run(codec, Settings(minutes=minutes, load=LOAD))
    noisy = run(codec, Settings(minutes=minutes, load=LOAD, ber=BER))
    lost = noisy["to_mcu"]["lost_intact"] + noisy["to_host"]["lost_intact"]
    late = max(clean[name]["longest_wait_us"] / clean[name]["wait_bound_us"] for name in ("to_mcu", "to_host"))
    mcu = clean["mcu_cpu_percent"]
    assert mcu is not None
    return [
        Figure("soak_line_use_to_mcu", 100 * clean["to_mcu"]["line_use"], "%", 99.5, COMMAND, at_most=False),
        Figure("soak_line_use_to_host", 100 * clean["to_host"]["line_use"], "%", 99.5, COMMAND, at_most=False),
        Figure("soak_unaccounted", clean["unaccounted"] + noisy["unaccounted"], "frames and bytes", 0, COMMAND),
        Figure("soak_lost_intact", lost, f"frames at BER {BER:g}", 0, COMMAND),
        Figure("soak_longest_wait", 100 * late, "% of what is allowed", 100, COMMAND),
        Figure("soak_virtual_speedup", clean["speedup"], "times real time", 60, COMMAND, at_most=False),
        Figure("soak_host_cpu", clean["host_cpu_percent"], "% of a core, without I/O", None, COMMAND),
        Figure("soak_mcu_cpu", mcu, "% of 170 MHz (computed)", None, COMMAND),
    ]


def measure_in_real_time(minutes: float = 1.0) -> list[Figure]:
    """Over a pair of ptys with a paced wire between them; how full it gets depends on what else this machine does."""
    command = "make bench ONLY=soak_real_time"
    clean = run(wirebond.load(PROTOCOL), Settings(minutes=minutes, load=LOAD, virtual=False))
    lost = clean["to_mcu"]["lost_intact"] + clean["to_host"]["lost_intact"]
    return [
        Figure("soak_real_line_use_to_mcu", 100 * clean["to_mcu"]["line_use"], "%", 99.5, command, at_most=False),
        Figure("soak_real_line_use_to_host", 100 * clean["to_host"]["line_use"], "%", 99.5, command, at_most=False),
        Figure("soak_real_unaccounted", clean["unaccounted"], "frames and bytes", 0, command),
        Figure("soak_real_lost", lost, "frames", 0, command),
        Figure("soak_real_host_cpu", clean["host_cpu_percent"], "% of a core, without Python", None, command),
    ]
