"""TFmini against tfmini, which reads from a sensor and never sends as one."""

from __future__ import annotations

import random
from typing import Any

from tfmini.tfmini import Std

from tests.contrib.oracle import Case, Oracle
from wirebond.protocol.model import End, Message


class _NoPort:
    is_open = False


class Tfmini(Oracle):
    lacks = frozenset({"configured"})

    def __init__(self) -> None:
        self._reader = Std.__new__(Std)  # without opening a port
        self._reader.serial = _NoPort()

    def values(self, message: Message, source: random.Random) -> dict[str, Any]:
        if message.name == "configure":
            return super().values(message, source) | {"spare": 0, "parameter": 0}
        return super().values(message, source) | {"mode": source.choice([2, 7]), "spare": 0}

    def encode(self, case: Case) -> bytes | None:
        if case.message != "configure":
            return None
        return b"\x42\x57\x02\0\0\0" + bytes(case.wire[2:])  # the library has them as constants

    def decode(self, frame: bytes, sender: End) -> Case | None:
        if sender == End.HOST:
            is_one = len(frame) == 8 and frame[:3] == b"\x42\x57\x02" and frame[7] in (2, 6)
            return Case("configure", sender, [int.from_bytes(frame[3:5], "little"), *frame[5:]]) if is_one else None
        if len(frame) != 9 or frame[:2] != b"\x59\x59":
            return None
        try:
            distance, strength = self._reader.process(frame[2:])
        except Exception:  # what the library raises on a wrong checksum
            return None
        return Case("measurement", sender, [round(100 * distance), strength, frame[6], frame[7]])
