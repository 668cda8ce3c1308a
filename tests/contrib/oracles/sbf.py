"""SBF against pysbf2."""

from __future__ import annotations

import random
from typing import Any

from pysbf2 import SBFMessage, SBFMessageError, SBFReader, SBFTypeError

from tests.contrib.oracle import Case, Oracle, Wire
from wirebond.protocol.model import End, Message

_UTC = ("UTCYear", "UTCMonth", "UTCDay", "UTCHour", "UTCMin", "UTCSec")
_DOP = ("TOW", "WNc", "NrSV", "Reserved", "PDOP", "TDOP", "HDOP", "VDOP", "HPL", "VPL")
_BLOCKS = {
    "dop": ("DOP", _DOP),
    "receiver_time": ("ReceiverTime", ("TOW", "WNc", *_UTC, "DeltaLS", "SyncLevel")),
    "end_of_pvt": ("EndOfPVT", ("TOW", "WNc")),
}
_NAMES = {block: name for name, (block, _) in _BLOCKS.items()}
_PADDED = ("receiver_time", "end_of_pvt")
_PADDING = 0x0201  # the library adds padding itself, with these bytes; their value has no meaning


class Sbf(Oracle):
    def header(self, message: Message, source: random.Random) -> dict[str, int]:
        return {"revision": 0}  # the library sends no other

    def values(self, message: Message, source: random.Random) -> dict[str, Any]:
        values = super().values(message, source)
        return values | ({"padding": _PADDING} if message.name in _PADDED else {})

    def encode(self, case: Case) -> bytes | None:
        block, names = _BLOCKS[case.message]
        numbers = case.wire[:-1] if case.message in _PADDED else case.wire
        flat = [n for value in numbers for n in (value if isinstance(value, list) else [value])]
        return bytes(SBFMessage(block, scaling=False, **dict(zip(names, flat, strict=True))).serialize())

    def decode(self, frame: bytes, sender: End) -> Case | None:
        try:
            message = SBFReader.parse(frame, scaling=False)
        except (SBFMessageError, SBFTypeError, IndexError):
            return None
        name = _NAMES.get(message.identity)
        if name is None or bytes(message.serialize()) != frame or int.from_bytes(frame[6:8], "little") != len(frame):
            return None  # the library reads whole blocks, found by others
        wire: Wire = [getattr(message, attribute) for attribute in _BLOCKS[name][1]]
        if name == "receiver_time":
            wire = [*wire[:2], wire[2:8], *wire[8:]]
        padding = int.from_bytes(frame[-2:], "little")
        return Case(name, sender, [*wire, padding] if name in _PADDED else wire, {"revision": 0})
