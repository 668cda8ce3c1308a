"""Measures the time that Wirebond adds to a round trip on a line with 90 % load in both directions. The rules:
bench/README.md.

Two ptys are joined by `wirebond wire` at 2 Mbaud 8N2. A probe of 45 bytes goes out each millisecond and comes back,
among other frames of its size that fill both directions. With Wirebond the near end is a Python program and the far
end generated C++; bare, both are C++ that reads and writes the same bytes through the same wire.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median, quantiles

import wirebond
from bench import native
from bench.figures import Figure
from bench.round_trip import PAIRS, PROTOCOL, VALID, Percentiles, processors, shown
from wirebond.sim.wire.process import LineShape, WireProcess, WireSettings

SECONDS = 4.0  # of one run: fifteen of them are a minute
USE = 0.9
TICK = 0.001
COMMAND = "make bench ONLY=loaded_round_trip"


def measure() -> list[Figure]:
    program = native.build("loaded_round_trip", PROTOCOL)
    allowed = os.sched_getaffinity(0)
    near, far = processors()
    rows = []
    lost = 0
    os.sched_setaffinity(0, near)
    try:
        for _ in range(PAIRS):
            row = []
            for run in (bare, with_wirebond, bare):
                trips, missing = run(program, far, SECONDS)
                lost += missing if run is with_wirebond else 0
                row.append(_percentiles(trips))
            rows.append(row)
            print(f"  bare {shown(row[0])}, wirebond {shown(row[1])}, bare {shown(row[2])}")
    finally:
        os.sched_setaffinity(0, allowed)
    control = median(behind[1] / before[1] for before, _, behind in rows)
    if not VALID[0] <= control <= VALID[1]:
        raise RuntimeError(f"void: bare against bare is {control:.2f} at p99; run it on a quiet machine")
    ratio = median(2 * ours[1] / (before[1] + behind[1]) for before, ours, behind in rows)
    added = median(ours[1] - (before[1] + behind[1]) / 2 for before, ours, behind in rows)
    return [
        Figure("rtt_loaded_over_bare_p99", ratio, "times", 2, COMMAND),
        Figure("rtt_loaded_added_p99_us", added / 1000, "µs", 300, COMMAND),
        Figure("rtt_loaded_bare_over_bare_p99", control, "times", None, COMMAND),
        Figure("rtt_loaded_lost", lost, "probes", 0, COMMAND),
    ]


def bare(program: Path, far: set[int], seconds: float) -> tuple[list[float], int]:
    """Round trips in nanoseconds, and how many probes did not come back."""
    with _wire(far) as wire, _far_end(program, "serve-bytes", wire.b, far, seconds):
        command = [str(program), "ask", wire.a, str(seconds)]
        out = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    trips = [float(line) for line in out[:-1]]
    return trips, int(out[-1].removeprefix("sent ")) - len(trips)


def with_wirebond(program: Path, far: set[int], seconds: float) -> tuple[list[float], int]:
    """Measure the round trips with a link at the near end."""
    sent: list[float] = []
    trips: list[float] = []
    with (
        _wire(far) as wire,
        wirebond.open(PROTOCOL, wire.a) as link,
        _far_end(program, "serve-frames", wire.b, far, seconds),
    ):
        sender = threading.Thread(target=_send, args=(link, sent, seconds))
        sender.start()
        until = time.monotonic() + seconds + 0.2
        while time.monotonic() < until:
            for message in link.receive(0.05):
                fields = message.fields
                if fields["flags"] == 1:
                    trips.append((message.t - sent[fields["number"]]) * 1e9)
        sender.join()
    return trips, len(sent) - len(trips)


def _send(link: wirebond.Link, sent: list[float], seconds: float) -> None:
    line = link.codec.model.link
    rate = USE * line.baud / line.bits_per_byte / 45
    values = [0.0] * 8
    began = time.monotonic()
    number = 0
    tick = 0
    while (now := time.monotonic()) < began + seconds:
        for i in range(int((now - began) * rate) - number):
            if i == 0:
                sent.append(time.monotonic())
                link.send("probe", number=len(sent) - 1, values=values, flags=1)
            else:
                link.send("probe", number=0, values=values, flags=0)
            number += 1
        tick += 1
        time.sleep(max(0.0, began + tick * TICK - time.monotonic()))


def _wire(processors: set[int]) -> WireProcess:
    wire = WireProcess(WireSettings(baud=2_000_000, line=LineShape(8, "N", 2)))
    os.sched_setaffinity(wire.pid, processors)
    return wire


@contextlib.contextmanager
def _far_end(program: Path, kind: str, path: str, processors: set[int], seconds: float) -> Iterator[None]:
    command = [str(program), kind, path, str(seconds)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        os.sched_setaffinity(process.pid, processors)
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield
        process.kill()


def _percentiles(trips: list[float]) -> Percentiles:
    cuts = quantiles(trips[len(trips) // 10 :], n=100)
    return cuts[49], cuts[98]
