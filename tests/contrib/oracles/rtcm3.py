"""RTCM 3 against pyrtcm, which frames any payload and reads its fields."""

from __future__ import annotations

import random
from typing import Any

from pyrtcm import RTCMMessage, RTCMReader
from pyrtcm.exceptions import RTCMMessageError, RTCMParseError, RTCMStreamError, RTCMTypeError

from tests.contrib.oracle import Case, Oracle, Wire
from wirebond.protocol.model import End, Message

# The library's name of each text; it numbers the letters, but joins them in the message that is one text.
_STRING = {
    "descriptor": "DF030", "serial_number": "DF033", "receiver": "DF228", "firmware": "DF230",
    "receiver_serial_number": "DF232", "text": "DF140",
}  # fmt: skip
_MESSAGES: dict[str, tuple[int, tuple[str, ...]]] = {
    "antenna": (1007, ("descriptor", "setup")),
    "antenna_and_serial_number": (1008, ("descriptor", "setup", "serial_number")),
    "text": (1029, ("day", "time", "text")),
    "receiver_and_antenna": (
        1033, ("descriptor", "setup", "serial_number", "receiver", "firmware", "receiver_serial_number")
    ),
}  # fmt: skip
_NAMES = {number: name for name, (number, _) in _MESSAGES.items()}


class Rtcm3(Oracle):
    def header(self, message: Message, source: random.Random) -> dict[str, int]:
        return {"station": source.randrange(4096)}

    def values(self, message: Message, source: random.Random) -> dict[str, Any]:
        values = super().values(message, source)
        for name, value in values.items():
            if name in _STRING and name != "text":  # the standard's letters are ASCII
                values[name] = "".join(source.choices("ABC 019-.", k=len(value)))
        return values

    def encode(self, case: Case) -> bytes | None:
        number, names = _MESSAGES[case.message]
        payload = (number << 12 | case.header["station"]).to_bytes(3, "big")
        for name, value in zip(names, case.wire, strict=True):
            if name in _STRING:
                payload += bytes([len(value)]) + value
            elif name == "time":
                payload += (value[0] << 7 | value[1]).to_bytes(3, "big")
            else:
                payload += value.to_bytes(2 if name == "day" else 1, "big")
        return bytes(RTCMMessage(payload=payload).serialize())

    def decode(self, frame: bytes, sender: End) -> Case | None:
        try:
            message = RTCMReader.parse(frame)
        except (RTCMMessageError, RTCMParseError, RTCMStreamError, RTCMTypeError, IndexError):
            return None
        name = _NAMES.get(message.DF002)
        if name is None or bytes(message.serialize()) != frame:
            return None
        wire: Wire = []
        for field in _MESSAGES[name][1]:
            if field in _STRING:
                wire.append(_letters(message, _STRING[field]))
            elif field == "time":
                wire.append([message.DF052, message.DF138])
            else:
                wire.append(message.DF051 if field == "day" else message.DF031)
        return Case(name, sender, wire, {"station": message.DF003})


def _letters(message: RTCMMessage, name: str) -> bytes:
    found = [value for key, value in vars(message).items() if key == name or key.startswith(f"{name}_")]
    return "".join(found).encode("latin-1")
