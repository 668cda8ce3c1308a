"""``queue_lost_4_producers``, ``queue_lost_8_producers``: frames that the send queue accepted and did not deliver.

Or not intact, not once, or not in order, of ten million that threads send as fast as they can. A plain ring behind a
mutex is measured beside it.

The program is that of the thread tests, ``tests/concurrency/stress.cpp``. A refused frame is offered again until it is
accepted. A rate is frames for each second of processor time of all threads together, so that other programs count less.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

from tests.concurrency.build import stress

from bench.figures import Figure

FRAMES = 10_000_000
COMMAND = "make bench ONLY=send_queue"


def run(program: Path, kind: str, senders: int, frames: int) -> dict[str, Any]:
    result = subprocess.run(
        [str(program), kind, str(senders), str(frames)], capture_output=True, text=True, check=False
    )
    assert result.stdout, result.stderr  # a frame that is lost is a figure, a crash is none
    told: dict[str, Any] = json.loads(result.stdout)
    return told


def measure(frames: int = FRAMES) -> list[Figure]:
    program = stress()
    figures = []
    for lost_key, senders in (("queue_lost_4_producers", 4), ("queue_lost_8_producers", 8)):
        queue = run(program, "outbox", senders, frames)
        control = run(program, "mutex", senders, frames)
        lost = queue["lost"] + (not queue["balances"])
        rate = queue["accepted"] / queue["processor_seconds"]
        control_rate = control["accepted"] / control["processor_seconds"]
        figures += [
            Figure(lost_key, lost, "frames", 0, COMMAND),
            Figure(f"mutex_lost_{senders}_producers", control["lost"], "frames", None, COMMAND),
            Figure(f"queue_rate_{senders}_producers", rate, "frames/s", None, COMMAND),
            Figure(f"mutex_rate_{senders}_producers", control_rate, "frames/s", None, COMMAND),
        ]
    return figures
