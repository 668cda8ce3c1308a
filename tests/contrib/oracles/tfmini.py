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
    def __init__(self) -> None:
        self._reader = Std.__new__(Std)  # without opening a port
        self._reader.serial = _NoPort()

    def values(self, message: Message, source: random.Random) -> dict[str, Any]:
        return super().values(message, source) | {"mode": source.choice([2, 7]), "spare": 0}

    def decode(self, frame: bytes, sender: End) -> Case | None:
        if len(frame) != 9 or frame[:2] != b"\x59\x59":
            return None
        try:
            distance, strength = self._reader.process(frame[2:])
        except Exception:  # what the library raises on a wrong checksum
            return None
        return Case("measurement", sender, [round(100 * distance), strength, frame[6], frame[7]])
