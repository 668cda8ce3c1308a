"""Measures the time that Wirebond adds to the round trip of a frame of 45 bytes over an idle pty. The rules:
bench/README.md.

Near end: the engine's link, with ``send`` from Python and the engine's own receive stamp. Far end: generated C++ that
decodes each frame and encodes it again. Against them: two C++ programs that write and read the same bytes, and nothing
more. Trips follow each other faster than the line's 2 Mbaud, so the link does not pace. The near end runs on one
processor and the far end on another one; the two take turns, bare before and behind.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median, quantiles

import wirebond
from bench import native
from bench.figures import Figure

PROTOCOL = Path(__file__).with_name("round_trip.yaml")
COMMAND = "make bench ONLY=round_trip"
PAIRS = 15
TRIPS = 4_000  # of one measurement
FEW = 200  # before them, that do not count
VALID = (0.8, 1.25)  # bare against bare: outside of it the machine was not quiet, and the run says nothing
GOAL = 2.0

Percentiles = tuple[float, float]  # p50 and p99, in nanoseconds
Ends = Callable[[Path, set[int]], Percentiles]  # by the far end's program and its processors


def measure() -> list[Figure]:
    rows = in_turns("bare", bare, with_wirebond)
    figures = []
    for i, name in enumerate(("p50", "p99")):
        control = median(behind[i] / before[i] for before, _, behind in rows)
        if not VALID[0] <= control <= VALID[1]:
            raise RuntimeError(f"void: bare against bare is {control:.2f} at {name}; run it on a quiet machine")
        ratio = median(2 * ours[i] / (before[i] + behind[i]) for before, ours, behind in rows)
        figures += [
            Figure(f"rtt_over_bare_{name}", ratio, "times", GOAL, COMMAND),
            Figure(f"rtt_bare_over_bare_{name}", control, "times", None, COMMAND),
            Figure(f"rtt_{name}_us", median(ours[i] for _, ours, _ in rows) / 1000, "µs", None, COMMAND),
        ]
    return figures


def in_turns(name: str, peer: Ends, ours: Ends) -> list[tuple[Percentiles, Percentiles, Percentiles]]:
    """The peer, Wirebond and the peer again, ``PAIRS`` times. Near ends have one processor, far ends another one."""
    program = native.build("round_trip", PROTOCOL)
    allowed = os.sched_getaffinity(0)
    near, far = processors()
    rows = []
    os.sched_setaffinity(0, near)  # what it starts is there, too
    try:
        for _ in range(PAIRS):
            row = (peer(program, far), ours(program, far), peer(program, far))
            rows.append(row)
            print(f"  {name} {shown(row[0])}, wirebond {shown(row[1])}, {name} {shown(row[2])}")
    finally:
        os.sched_setaffinity(0, allowed)
    return rows


def shown(trip: Percentiles) -> str:
    return f"{trip[0] / 1000:.1f} µs (p99 {trip[1] / 1000:.1f})"


def processors() -> tuple[set[int], set[int]]:
    allowed = sorted(os.sched_getaffinity(0))
    if len(allowed) < 2:
        raise RuntimeError("this benchmark needs two processors")
    return {allowed[0]}, {allowed[1]}


@contextlib.contextmanager
def far_end(program: Path, kind: str, processors: set[int]) -> Iterator[str]:
    with subprocess.Popen([str(program), kind], stdout=subprocess.PIPE, text=True) as process:
        os.sched_setaffinity(process.pid, processors)
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.kill()


def bare(program: Path, far: set[int], trips: int = TRIPS) -> Percentiles:
    with far_end(program, "echo-bytes", far) as path:
        run = subprocess.run([str(program), "ask", path, str(FEW + trips)], capture_output=True, text=True, check=True)
    return percentiles([float(line) for line in run.stdout.split()])


def with_wirebond(program: Path, far: set[int], trips: int = TRIPS) -> Percentiles:
    took = []
    values = [0.5 * i for i in range(8)]
    with far_end(program, "echo-frames", far) as path, wirebond.open(PROTOCOL, path, paced=False) as link:
        for number in range(FEW + trips):
            began = time.monotonic()
            link.send("probe", number=number, values=values, flags=7)
            [message] = link.receive(10)
            assert message.fields["number"] == number
            took.append((message.t - began) * 1e9)
    return percentiles(took)


def percentiles(took: list[float]) -> Percentiles:
    cuts = quantiles(took[FEW:], n=100)
    return cuts[49], cuts[98]
