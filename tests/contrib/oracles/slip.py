"""SLIP against sliplib."""

from __future__ import annotations

import random
from typing import Any

import sliplib

from tests.contrib.oracle import Case, Oracle
from wirebond.protocol.model import End, Message

_LONGEST = 1006  # bytes of a datagram by RFC 1055; the library has no limit


class Slip(Oracle):
    def values(self, message: Message, source: random.Random) -> dict[str, Any]:
        special = bytes([0xC0, 0xDB, 0xDC, 0xDD])
        size = source.choice([1, 2, 20, 300, _LONGEST])
        plain = source.randbytes(size)
        return {"data": bytes(source.choice(special) if source.random() < 0.2 else byte for byte in plain)}

    def encode(self, case: Case) -> bytes | None:
        return sliplib.END + sliplib.encode(case.wire[0]) + sliplib.END

    def decode(self, frame: bytes, sender: End) -> Case | None:
        datagram = frame[:-1].removeprefix(sliplib.END)  # the one in front may be missing, the one behind may not
        if frame[-1:] != sliplib.END or not datagram:
            return None
        try:
            data = sliplib.decode(datagram)
        except sliplib.ProtocolError:
            return None
        return Case("datagram", sender, [data]) if len(data) <= _LONGEST else None
