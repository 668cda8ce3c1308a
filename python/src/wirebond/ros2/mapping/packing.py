"""Prepares the bytes of a topic for the engine: the constant bytes, and the places of the changing ones.

Made once from a mapping. `wirebond._engine.CdrPacker` applies it; what it cannot, the mapping's filler does.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class PackedValue:
    """A number of the topic that comes from the message.

    :ivar at: its place in the topic's bytes.
    :ivar code: its type, as `struct` has it.
    :ivar path: of a field of the message, or of a flag: names, and indexes as digits.
    :ivar chosen: the bytes for each name of an enum, or for ``true`` and ``false``; None: the value itself, times
        ``scale``, plus ``offset``.
    """

    at: int
    code: str
    path: tuple[str, ...]
    scale: float = 1.0
    offset: float = 0.0
    chosen: dict[str, bytes] | None = None


@dataclass(frozen=True)
class PackPlan:
    """A topic's message whose changing values are numbers.

    :ivar message: of the protocol.
    :ivar data: the topic's bytes, with every constant.
    :ivar seconds: the place of a stamp's seconds, ``nanoseconds`` that of its nanoseconds.
    """

    message: str
    data: bytes
    seconds: tuple[int, ...]
    nanoseconds: tuple[int, ...]
    values: tuple[PackedValue, ...]


def packed_choices(code: str, chosen: Mapping[str, Any]) -> dict[str, bytes] | None:
    """Return the bytes of each; None where one is not of this type."""
    try:
        return {word: struct.pack(f"<{code}", value) for word, value in chosen.items()}
    except struct.error:
        return None
