"""``python -m bench [--only NAME]``: run the benchmarks, print their tables, write bench/latest.json."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable

from bench import (
    collateral,
    columns,
    console,
    console_page,
    console_scrub,
    frame_cost,
    host_cpu,
    loaded_round_trip,
    m4_cost,
    m4_runtime,
    mcu_line,
    reconnect,
    recordings,
    ros2,
    round_trip,
    send_queue,
    serve,
    soak,
    work_per_byte,
)
from bench.figures import LATEST, ROOT, Figure, keep, show

BENCHMARKS: dict[str, tuple[str, Callable[[], list[Figure]]]] = {
    "collateral": (
        "Intact frames lost on a faulty line (enterprize, 1e6 frames a fault)",
        collateral.measure,
    ),
    "clean_loss": (
        "Frames lost on a perfect line, at every chunk size from 1 to 4096",
        collateral.measure_clean,
    ),
    "console": (
        "What the console's server costs while a page looks on, and how long a look at an hour takes",
        console.measure,
    ),
    "frame_cost": ("What a frame of 48 or 45 bytes costs the run-time engine (enterprize)", frame_cost.measure),
    "columns": ("From bytes to values in Python (the nine enterprize messages in equal shares)", columns.measure),
    "console_page": ("The console's page at 8 000 messages/s: smooth, current, quick to answer", console_page.measure),
    "console_scrub": ("An hour of history under the hand: no pause, no lost peak", console_scrub.measure),
    "serve": ("What it costs to share a link: the server's processor time, and what attaching adds", serve.measure),
    "host_cpu": ("What a full line of 2 Mbaud costs a Python program, both ways", host_cpu.measure),
    "loaded_round_trip": (
        "The same on a line that is used to 90 % both ways, through `wirebond wire`",
        loaded_round_trip.measure,
    ),
    "m4_cost": ("What a frame costs generated C++ on an emulated Cortex-M4 (enterprize)", m4_cost.measure),
    "m4_runtime": ("What a link costs a Cortex-M: sends, interrupts, memory", m4_runtime.measure),
    "mcu_line": ("The MCU's end on a simulated UART: its clock, and a line with errors (native)", mcu_line.measure),
    "reconnect": ("From a device's appearance to its first message, under load", reconnect.measure),
    "recordings": ("From a recording of 10 million messages to columns; 90 minutes of the rover", recordings.measure),
    "ros2": ("What the bridge to ROS 2 costs at 8 000 messages a second each way (enterprize)", ros2.measure),
    "round_trip": ("The round trip of a frame of 45 bytes over an idle pty, against bare C++", round_trip.measure),
    "send_queue": ("Frames that threads send through one queue, 10 million", send_queue.measure),
    "soak": ("A full line under virtual time, 90 minutes (enterprize, load 1.2)", soak.measure),
    "soak_real_time": ("The same for a minute in real time, over a paced pair of ptys", soak.measure_in_real_time),
    "work_per_byte": ("Instructions per received byte, worst input (enterprize)", work_per_byte.measure),
}


def main() -> int:
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__)
    parser.add_argument("--only", choices=BENCHMARKS, metavar="NAME", help=f"one of {', '.join(BENCHMARKS)}")
    only = parser.parse_args().only
    met = True
    for name, (title, measure) in BENCHMARKS.items():
        if only not in (None, name):
            continue
        figures = measure()
        show(title, figures)
        keep(figures)
        met = met and all(figure.met for figure in figures)
    print(f"written to {LATEST.relative_to(ROOT)}")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
