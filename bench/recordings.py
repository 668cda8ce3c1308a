"""``replay_messages_per_s``: a recording of 10 million messages, from the file to columns with times. What closing it
costs. How large 90 minutes of the rover are when they are closed. And what recording costs a program.

The recordings are made under virtual time, of frames that the codec encodes: the messages of the rover at its rates,
with values that change, and reads at times that are never quite the same. ``recorder_cpu`` is the processor time of the
two threads that record a link with 8 000 messages a second.
"""

from __future__ import annotations

import math
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import wirebond
from bench.figures import ROOT, Figure
from bench.serve import PER_SECOND, PROTOCOL, feeder, line, say
from wirebond.link.tap import Chunk
from wirebond.recording.closing import close_recording
from wirebond.recording.writer import RecordingWriter

MESSAGES = 10_000_000
MINUTES = 90.0
ROUNDS = 3
IN_A_READ = 8  # frames
COMMAND = "make bench ONLY=recordings"
RECORDED = 5.0  # seconds
CLOSER = """
import re, sys, time
from pathlib import Path
from wirebond.recording.closing import close_recording
began = time.perf_counter()
close_recording(Path(sys.argv[1]))
print(time.perf_counter() - began, int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) / 1e3)
"""
_BATCH = 1000  # pieces between two writes


def measure(messages: int = MESSAGES, minutes: float = MINUTES, rounds: int = ROUNDS) -> list[Figure]:
    codec = wirebond.load(ROOT / "protocols" / "diffdrive.yaml")
    with tempfile.TemporaryDirectory() as folder:
        path = _made(Path(folder) / "long.mcap", codec, _odometry(codec, messages))
        rates = [_rate(path, messages) for _ in range(rounds)]
        closing_long, peak = _closed_apart(path)
        rover = _made(Path(folder) / "rover.mcap", codec, _rover(codec, minutes * 60))
        start = time.perf_counter()
        close_recording(rover)
        closing = time.perf_counter() - start
        size = rover.stat().st_size
        closed = _rate(rover, None)
    return [
        Figure("replay_messages_per_s", median(rates), "messages/s", 2e6, COMMAND, at_most=False),
        Figure("replay_messages_per_s_closed", closed, "messages/s", None, COMMAND, at_most=False),
        Figure("recording_closing_messages_per_s", messages / closing_long, "messages/s", None, COMMAND, at_most=False),
        Figure("recording_closing_peak_mb", peak, "MB", 256, COMMAND),
        Figure("recorder_cpu", 100 * median(_recorder_cpu() for _ in range(rounds)), "% of a core", 10, COMMAND),
        Figure("recording_90_min_mb", size / 1e6, "MB", 6.0, COMMAND),
        Figure("recording_90_min_closing_s", closing, "s", None, COMMAND),
    ]


def _closed_apart(path: Path) -> tuple[float, float]:
    """Seconds, and the MB of memory that the process had at most."""
    found = subprocess.run([sys.executable, "-c", CLOSER, str(path)], capture_output=True, text=True, check=True)
    seconds, peak = found.stdout.split()
    return float(seconds), float(peak)


def _recorder_cpu() -> float:
    """The share of a core."""
    with (
        feeder(RECORDED, PER_SECOND // 1000) as (feed, port),
        tempfile.TemporaryDirectory() as folder,
        wirebond.open(PROTOCOL, port) as link,
    ):
        recorder = link.record(Path(folder) / "run.mcap")
        clocks = [time.pthread_getcpuclockid(t.ident) for t in (recorder._thread, recorder._disk) if t.ident]
        say(feed)
        sent, _ = map(int, line(feed).split())
        while recorder.bytes < sent * 11:
            link.receive(0.05)
        spent = sum(time.clock_gettime(clock) for clock in clocks)
        recorder.close(compact=False)
        say(feed)
        if recorder.lost_bytes:
            raise RuntimeError("the recorder lost bytes")
        return spent / RECORDED


def _rate(path: Path, messages: int | None) -> float:
    """Messages a second, from opening the file."""
    start = time.perf_counter()
    found = wirebond.recording.open(path)
    columns = [found.columns(sender) for sender in ("mcu", "host")]
    seconds = time.perf_counter() - start
    rows = sum(len(table) for one in columns for table in one.values())
    assert messages in (None, rows)
    assert all(table.t is not None for one in columns for table in one.values())
    return rows / seconds


def _made(path: Path, codec: wirebond.Codec, pieces: Iterator[Chunk]) -> Path:
    writer = RecordingWriter(path, codec, "host", 0.0, 1_795_000_000 * 10**9, {})
    for number, piece in enumerate(pieces):
        writer.add(piece)
        if number % _BATCH == 0:
            writer.flush()
    writer.finish()
    writer.close()
    return path


def _odometry(codec: wirebond.Codec, messages: int) -> Iterator[Chunk]:
    source = random.Random("recordings")
    ticks = [(source.randrange(-300, 300), source.randrange(-300, 300)) for _ in range(1000 * IN_A_READ)]
    frames = [codec.encode("odometry", left_ticks=left, right_ticks=right) for left, right in ticks]
    reads = [b"".join(frames[i : i + IN_A_READ]) for i in range(0, len(frames), IN_A_READ)]
    for number in range(messages // IN_A_READ):
        t = 0.001 * number
        yield Chunk(t + 0.00002, t, "received", reads[number % len(reads)])


def _rover(codec: wirebond.Codec, seconds: float) -> Iterator[Chunk]:
    source = random.Random("rover")
    for step in range(round(seconds * 20)):
        t = step * 0.05
        sent = t + source.uniform(0, 0.0004)
        wanted = {"linear": round(0.5 * math.sin(t / 7), 3), "angular": round(0.8 * math.cos(t / 5), 3)}
        yield Chunk(sent, sent, "sent", codec.encode("velocity", wanted))
        ticks = {side: round(40 * math.sin(t / 7) + source.gauss(0, 1)) for side in ("left_ticks", "right_ticks")}
        read = t + 0.02 + source.uniform(0, 0.0015)
        yield Chunk(read + source.uniform(5e-6, 6e-5), read, "received", codec.encode("odometry", ticks))
        if step % 20 == 0:
            yield Chunk(t + 0.03, t + 0.03, "sent", codec.encode("status_query"))
            status = codec.encode("status", {"battery": round(12.6 - t / 5400, 3), "errors": [], "state": []})
            yield Chunk(t + 0.0321, t + 0.032, "received", status)
