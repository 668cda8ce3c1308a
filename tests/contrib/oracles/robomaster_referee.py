"""The referee system's frame as its appendix draws it, with both checks by crccheck; no library of it is published."""

from __future__ import annotations

import random
import struct

from crccheck.crc import Crc8Base, Crc16Mcrf4XX

from tests.contrib.oracle import Case, Oracle, Wire
from wirebond.protocol.model import End, Message

_HEADER = struct.Struct("<BHBB")
_MESSAGES = {  # by message: its number and its fields in one piece; those with bits apart
    "game_state": (0x0001, "<BHQ"),
    "robot_state": (0x0201, "<BBHHHHHB"),
    "power_and_heat": (0x0202, "<HHfHHHH"),
    "shot": (0x0207, "<BBBf"),
    "interaction": (0x0301, "<HHH"),
}
_NAMES = {number: name for name, (number, _) in _MESSAGES.items()}


class _HeaderCheck(Crc8Base):
    _poly = 0x31
    _initvalue = 0xFF
    _reflect_input = True
    _reflect_output = True


class RobomasterReferee(Oracle):
    def header(self, message: Message, source: random.Random) -> dict[str, int]:
        return {"sequence": source.randrange(256)}

    def encode(self, case: Case) -> bytes | None:
        number, layout = _MESSAGES[case.message]
        wire = list(case.wire)
        data = wire.pop() if case.message == "interaction" else b""
        if case.message == "game_state":
            wire[0] = wire[0][0] | wire[0][1] << 4
        flat = [n for value in wire for n in (value if isinstance(value, list) else [value])]
        payload = struct.pack(layout, *flat) + data
        head = struct.pack("<BHB", 0xA5, len(payload), case.header["sequence"])
        frame = head + bytes([_HeaderCheck.calc(head)]) + number.to_bytes(2, "little") + payload
        return frame + Crc16Mcrf4XX.calc(frame).to_bytes(2, "little")

    def decode(self, frame: bytes, sender: End) -> Case | None:
        if len(frame) < 9 or frame[0] != 0xA5:
            return None
        _, size, sequence, check = _HEADER.unpack_from(frame)
        if check != _HeaderCheck.calc(frame[:4]) or len(frame) != 9 + size:
            return None
        if Crc16Mcrf4XX.calc(frame[:-2]) != int.from_bytes(frame[-2:], "little"):
            return None
        name = _NAMES.get(int.from_bytes(frame[5:7], "little"))
        if name is None:
            return None
        payload, layout = frame[7:-2], _MESSAGES[name][1]
        fixed = struct.calcsize(layout)
        if len(payload) < fixed or (len(payload) > fixed and name != "interaction"):
            return None
        wire: Wire = list(struct.unpack_from(layout, payload))
        if name == "game_state":
            wire[0] = [wire[0] & 15, wire[0] >> 4]
        if name == "power_and_heat":
            wire[4:6] = [wire[4:6]]
        if name == "interaction":
            wire.append(payload[fixed:])
        return Case(name, sender, wire, {"sequence": sequence})
