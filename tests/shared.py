"""Shared by several tests: the protocol files and the vectors."""

from __future__ import annotations

import contextlib
import fcntl
import json
import random
import socket
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import wirebond
from tests.compilers import CXX
from tests.waiting import moments
from wirebond.protocol.apart import ends_look_alike
from wirebond.protocol.loader import loads
from wirebond.protocol.model import Protocol
from wirebond.protocol.planning import ids_collide
from wirebond.sim import rover

ROOT = Path(__file__).resolve().parents[1]
PROTOCOLS = ROOT / "protocols"
VECTORS = ROOT / "tests" / "vectors"
QUICK_CXXFLAGS = "-O0 -DWIREBOND_INLINE=inline -DWIREBOND_INLINE_LAMBDA="  # programs compile quickly, and run slowly


def few_or_many(few: int, many: int) -> pytest.MarkDecorator:
    """Runs a test with ``number`` twice: with few in `make test`, and with many in `make prove`."""
    return pytest.mark.parametrize("number", [few, pytest.param(many, marks=pytest.mark.long)])


def lasting_port() -> int:
    """A TCP port of loopback that nothing listens at, for a server that closes it and opens it again.

    It is below the range from which the kernel gives ports to other programs meanwhile.
    """
    chance = random.SystemRandom()
    end = int(Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()[0])
    for _ in moments("a free port"):
        number = chance.randrange(end // 2, end)
        with contextlib.suppress(OSError), socket.create_server(("127.0.0.1", number)):
            return number
    raise AssertionError


@dataclass(frozen=True)
class Vector:
    protocol: str
    message: str
    sender: str
    fields: dict[str, Any]
    frame: bytes

    def __str__(self) -> str:
        return f"{self.protocol}-{self.frame.hex()}"


@dataclass(frozen=True)
class Rejected:
    protocol: str
    why: str
    frame: bytes

    def __str__(self) -> str:
        return f"{self.protocol}-{self.frame.hex()}"


def accepted_vectors() -> list[Vector]:
    return [
        Vector(path.stem, row["message"], row["sender"], row["fields"], bytes.fromhex(row["hex"]))
        for path in sorted(VECTORS.glob("*.json"))
        if path.stem != "rejected"
        for row in json.loads(path.read_text())
    ]


def rejected_vectors() -> list[Rejected]:
    rows = json.loads((VECTORS / "rejected.json").read_text())
    return [Rejected(row["protocol"], row["why"], bytes.fromhex(row["hex"])) for row in rows]


@cache
def loaded(path: Path) -> wirebond.Codec:
    """The protocol of a file that no test writes: hundreds of tests ask for the same hundred files."""
    return wirebond.load(path)


def codec(name: str) -> wirebond.Codec:
    return loaded(PROTOCOLS / f"{name}.yaml")


def codec_without_latest(name: str) -> wirebond.Codec:
    """For tests that send many of a message at once, and expect each of them to leave."""
    text = (PROTOCOLS / f"{name}.yaml").read_text(encoding="utf-8")
    return wirebond.Codec(loads(text.replace("queue: latest", "queue: normal")))


def rover_program() -> Path:
    """The rover's firmware for this machine, compiled once for all tests, without optimisation."""
    folder = ROOT / "build" / "rover"
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as lock, pytest.MonkeyPatch.context() as patch:
        fcntl.flock(lock, fcntl.LOCK_EX)
        patch.setenv("CXX", CXX)
        patch.setenv("CXXFLAGS", QUICK_CXXFLAGS)
        return rover.build(folder)


def account_closes(stats: wirebond.Stats) -> bool:
    """Every byte in exactly one bucket."""
    settled = stats.frame_bytes + stats.fill_bytes + sum(stats.discarded_bytes.values())
    return stats.bytes == settled + stats.pending_bytes


def needs_sender(model: Protocol) -> bool:
    """Must a decoder know whose bytes it gets?"""
    return bool(ids_collide(model)) or ends_look_alike(model.format.parts)
