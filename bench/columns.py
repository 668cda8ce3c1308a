"""Frames a second from bytes to values in Python, against other ways to do the same. The rules: bench/README.md.

``columns_frames_per_s``: a whole capture to a column for each field. ``messages_per_s``: every message for itself,
every field of it read. In the same run, all codecs taking turns; medians over the rounds, ratios within a round.
``columns_groups_frames_per_s``: the states of twelve joints, as `wirebond new --has joints=12` describes them, to 37
columns.
"""

from __future__ import annotations

import gc
import importlib
import random
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from statistics import median

from bench.figures import Figure
from bench.peers.wirebond_codec import Wirebond
from bench.peers.work import Codec, Sample, samples
from bench.report import Comparison, write_comparison
from wirebond.codec import Codec as Protocol
from wirebond.generate.new.template import template_text
from wirebond.protocol import loads

FRAMES = 90_000
ROUNDS = 9
LEAST_SECONDS = 0.1  # of one measurement: the work is done again until so much time has gone by
JOINTS = 12
REPEATED = 10  # how often the frames of joints stand in their stream
COMMAND = "make bench ONLY=columns"

PEERS = (
    ("bench.peers.struct_codec", "StructCrc", 1),
    ("bench.peers.struct_codec", "CobsStruct", 1),
    ("bench.peers.protobuf_codec", "Protobuf", 1),
    ("bench.peers.mavlink_codec", "Mavlink", 3),
    ("bench.peers.serial_transfer_codec", "SerialTransfer", 30),  # gets a thirtieth of the frames
)


@dataclass(frozen=True)
class Entry:
    codec: Codec
    stream: bytes
    frames: int


def codecs() -> list[tuple[Codec, int]]:
    """Wirebond, and the peers that are installed, each with its part of the frames: one in this many."""
    found: list[tuple[Codec, int]] = [(Wirebond(), 1)]
    for module, name, part in PEERS:
        try:
            found.append((getattr(importlib.import_module(module), name)(), part))
        except (ImportError, RuntimeError) as reason:
            print(f"{name} is left out: {reason}. Its package is listed in requirements-dev.txt.")
    return found


def entries(frames: int) -> list[Entry]:
    return [_entry(codec, samples(frames // part)) for codec, part in codecs()]


def _entry(codec: Codec, content: list[Sample]) -> Entry:
    return Entry(codec, codec.stream(content), len(content))


def rate(work: Callable[[bytes], object], entry: Entry, least_seconds: float) -> float:
    """Frames a second."""
    times = 0
    gc.collect()  # nobody pays for others' garbage; for his own he does, as programs do
    start = time.perf_counter()
    while True:
        work(entry.stream)
        times += 1
        seconds = time.perf_counter() - start
        if seconds >= least_seconds:
            return entry.frames * times / seconds


def joint_states(frames: int) -> tuple[Protocol, bytes]:
    """The protocol of twelve joints, and a byte stream of `frames` of its frames."""
    protocol = Protocol(loads(template_text("native", "legs", {"joints": JOINTS}), "legs.yaml"))
    chance = random.Random(1)
    data = bytearray()
    for number in range(frames // REPEATED):
        joints = [
            {"position": chance.uniform(-3, 3), "velocity": chance.uniform(-9, 9), "torque": chance.uniform(-20, 20)}
            for _ in range(JOINTS)
        ]
        data += protocol.encode("joint_states", measured=number * 20_000, joints=joints)
    return protocol, bytes(data) * REPEATED


def measure_groups(frames: int = FRAMES, rounds: int = ROUNDS, least_seconds: float = LEAST_SECONDS) -> Figure:
    """Frames a second, the median over the rounds.

    :raises RuntimeError: a frame is missing, or a column.
    """
    protocol, stream = joint_states(frames)
    table = protocol.decode_columns(stream)["joint_states"]
    if len(table) != frames or len(table.fields) != 1 + 3 * JOINTS:
        raise RuntimeError(f"{len(table)} of {frames} frames came as {len(table.fields)} columns")
    rates = []
    for _ in range(rounds):
        times, start, seconds = 0, time.perf_counter(), 0.0
        while seconds < least_seconds:
            protocol.decode_columns(stream)
            times, seconds = times + 1, time.perf_counter() - start
        rates.append(frames * times / seconds)
    return Figure("columns_groups_frames_per_s", median(rates), "frames/s", 1e6, COMMAND, at_most=False)


def measure(frames: int = FRAMES, rounds: int = ROUNDS, least_seconds: float = LEAST_SECONDS) -> list[Figure]:
    contest = entries(frames)
    columns: dict[str, list[float]] = {entry.codec.name: [] for entry in contest}
    messages: dict[str, list[float]] = {entry.codec.name: [] for entry in contest}
    for _ in range(rounds):
        for entry in contest:
            columns[entry.codec.name].append(rate(entry.codec.columns, entry, least_seconds))
            messages[entry.codec.name].append(rate(entry.codec.messages, entry, least_seconds))
    for title, found in (("columns", columns), ("messages", messages)):
        comparison = Comparison(
            key=title,
            title=f"Frames a second from bytes to {title} in Python",
            unit="frames/s",
            rows={name: median(rates) for name, rates in found.items()},
            notes={e.codec.name: f"{e.codec.package} {version(e.codec.package)}, {e.codec.licence}" for e in contest},
        )
        write_comparison(comparison)

    ours = columns[Wirebond.name]
    figures = [Figure("columns_frames_per_s", median(ours), "frames/s", 5e6, COMMAND, at_most=False)]
    for key, peer, goal in (
        ("columns_over_pymavlink", "pymavlink", 30.0),
        ("columns_over_struct", "struct + C CRC", 3.0),
    ):
        if peer in columns:
            ratio = median(a / b for a, b in zip(ours, columns[peer], strict=True))
            figures.append(Figure(key, ratio, "times", goal, COMMAND, at_most=False))
    found = median(messages[Wirebond.name])
    figures.append(Figure("messages_per_s", found, "messages/s", 4e5, COMMAND, at_most=False))
    figures.append(measure_groups(frames, rounds, least_seconds))
    return figures
