"""``python -m bench [--only NAME]``: run the benchmarks, print their tables, write bench/latest.json.

Each benchmark runs in a process of its own and is ended at its limit, and all of them end within half an hour.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from bench import (
    collateral,
    columns,
    console,
    console_page,
    console_scrub,
    encoding,
    frame_cost,
    host_cpu,
    loaded_round_trip,
    m4_cost,
    m4_runtime,
    mcu_line,
    page_decode,
    page_frames,
    python_round_trip,
    reconnect,
    recordings,
    ros2,
    round_trip,
    send_queue,
    serve,
    soak,
    work_per_byte,
)
from bench.figures import LATEST, ROOT, Figure, Verdict, keep, show
from bench.noise import Noise

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
    "encoding": ("From values to bytes in Python (the nine enterprize messages in equal shares)", encoding.measure),
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
    "page_decode": (
        "From bytes to values in JavaScript, by the engine in WebAssembly (enterprize)",
        page_decode.measure,
    ),
    "page_frames": ("A page without a server: small, soon there, smooth", page_frames.measure),
    "reconnect": ("From a device's appearance to its first message, under load", reconnect.measure),
    "recordings": ("From a recording of 10 million messages to columns; 90 minutes of the rover", recordings.measure),
    "ros2": ("What the bridge to ROS 2 costs at 8 000 messages a second each way (enterprize)", ros2.measure),
    "round_trip": ("The round trip of a frame of 45 bytes over an idle pty, against bare C++", round_trip.measure),
    "python_round_trip": ("The same in Python, against pyserial that only writes and reads", python_round_trip.measure),
    "send_queue": ("Frames that threads send through one queue, 10 million", send_queue.measure),
    "soak": ("A full line under virtual time, 90 minutes (enterprize, load 1.2)", soak.measure),
    "soak_real_time": ("The same for a minute in real time, over a paced pair of ptys", soak.measure_in_real_time),
    "work_per_byte": ("Instructions per received byte, worst input (enterprize)", work_per_byte.measure),
}


TOTAL = 1750.0  # seconds for all of them
LIMIT = 75.0  # seconds for each benchmark, except:
LIMITS = {
    "console_page": 150.0,
    "loaded_round_trip": 300.0,
    "page_frames": 240.0,
    "reconnect": 180.0,
    "ros2": 180.0,
    "serve": 180.0,
    "soak_real_time": 120.0,  # a minute, and its program is compiled first
}
_GRACE = 5.0  # seconds for a benchmark to end what it started


def measure_in_child(name: str, limit: float) -> list[Figure] | None:
    """Return the figures of a measurement that runs in its own process. None: it failed or did not end in time, which
    is printed.

    :param limit: seconds.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "figures"
        command = [sys.executable, "-m", "bench", "--only", name, "--into", str(file)]
        with subprocess.Popen(command, cwd=ROOT, start_new_session=True) as child:
            try:
                child.wait(limit)
            except subprocess.TimeoutExpired:
                print(f"{name} did not end within its {limit:g} s", flush=True)
            finally:
                _end(child)
        if child.returncode != 0 or not file.exists():
            return None
        return [Figure(**row) for row in json.loads(file.read_text())]


def _end(child: subprocess.Popen[bytes]) -> None:
    """End the process and all that it started."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(child.pid, number)
            child.wait(_GRACE)
        except ProcessLookupError:
            return
        except subprocess.TimeoutExpired:
            continue


def run(names: list[str]) -> int:
    began = time.monotonic()
    not_measured, not_met, not_judged = list[str](), list[str](), list[str]()
    for name in names:
        limit = min(LIMITS.get(name, LIMIT), max(began + TOTAL - time.monotonic(), 0.0))
        print(f"\n{name}, at most {limit:.0f} s", flush=True)
        noise = Noise()
        noise.begin()
        figures = measure_in_child(name, limit)
        noises = noise.end()
        if figures is None:
            not_measured.append(name)
            continue
        show(BENCHMARKS[name][0], figures, noises)
        keep(figures, noises)
        not_met += [figure.key for figure in figures if figure.verdict(noises) is Verdict.NO]
        not_judged += [figure.key for figure in figures if figure.verdict(noises) is Verdict.NOT_JUDGED]
    for title, keys in (
        ("not measured", not_measured),
        ("goal not reached", not_met),
        ("not judged, because this machine was not quiet", not_judged),
    ):
        if keys:
            print(f"\n{title}: {', '.join(keys)}")
    print(f"\n{time.monotonic() - began:.0f} s; the figures are in {LATEST.relative_to(ROOT)}")
    return 1 if not_measured or not_met else 0


def main() -> int:
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__)
    parser.add_argument("--only", choices=BENCHMARKS, metavar="NAME", help=f"one of {', '.join(BENCHMARKS)}")
    parser.add_argument("--into", type=Path, help=argparse.SUPPRESS)  # in the child: the file for what it measured
    chosen = parser.parse_args()
    if chosen.into is not None:
        _, measure = BENCHMARKS[chosen.only]
        chosen.into.write_text(json.dumps([asdict(figure) for figure in measure()]))
        return 0
    return run([chosen.only] if chosen.only else list(BENCHMARKS))


if __name__ == "__main__":
    sys.exit(main())
