"""HDLC against yahdlc, which sends information frames that poll, and acknowledges or rejects them."""

from __future__ import annotations

import random
from typing import Any

import yahdlc

from tests.contrib.oracle import Case, Oracle
from wirebond.protocol.model import End, Message

_SENT = {"ready": yahdlc.FRAME_ACK, "reject": yahdlc.FRAME_NACK}


class Hdlc(Oracle):
    lacks = frozenset({"not_ready"})

    def header(self, message: Message, source: random.Random) -> dict[str, Any]:
        number = source.randrange(8)
        if message.name == "information":
            return {"address": 0xFF, "send": number, "poll": 1, "receive": 0}
        return {"address": 0xFF, "poll": 0, "receive": number}

    def encode(self, case: Case) -> bytes | None:
        if case.message == "information":
            return bytes(yahdlc.frame_data(case.wire[0], yahdlc.FRAME_DATA, case.header["send"]))
        return bytes(yahdlc.frame_data(b"", _SENT[case.message], case.header["receive"]))

    def decode(self, frame: bytes, sender: End) -> Case | None:
        if frame[-1:] != b"\x7e" or b"\x7e" in frame[:-1].removeprefix(b"\x7e"):
            return None  # the library is given one frame
        if b"\x7d\x7d" in frame:
            return None  # the library takes two escapes for one; by RFC 1662 they are a byte 0x5D
        try:
            yahdlc.get_data_reset()
            data, kind, number = yahdlc.get_data(frame)
        except (yahdlc.FCSError, yahdlc.MessageError):
            return None
        if kind == yahdlc.FRAME_DATA:
            return Case(
                "information", sender, [bytes(data)], {"address": 0xFF, "send": number, "poll": 1, "receive": 0}
            )
        if frame.strip(b"\x7e")[1] >> 1 & 7 not in (0, 4):  # the library takes every other kind for a rejection
            return None
        name = "ready" if kind == yahdlc.FRAME_ACK else "reject"
        return Case(name, sender, [], {"address": 0xFF, "poll": 0, "receive": number})
