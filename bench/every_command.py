"""The enterprize format for benchmarks that count frames: no command takes the place of one that waits."""

from __future__ import annotations

from bench.collateral import PROTOCOL
from wirebond import Codec
from wirebond.protocol.loader import loads


def text() -> str:
    """The protocol file without ``queue: latest``."""
    return PROTOCOL.read_text(encoding="utf-8").replace("    queue: latest\n", "")


def codec() -> Codec:
    """Return the loaded protocol."""
    return Codec(loads(text()))
