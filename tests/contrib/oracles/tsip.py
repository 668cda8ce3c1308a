"""TSIP against tsip, which frames and stuffs; the fields are packed here."""

from __future__ import annotations

import struct

from tsip import llapi

from tests.contrib.oracle import Case, Oracle, Wire
from wirebond.protocol.model import End

_HOST = {
    0x1F: ("read_software_version", ">"),
    0x2B: ("set_position", ">fff"),
    0x21: ("read_time", ">"),
    0x31: ("set_first_position", ">ddd"),
}
_MCU = {0x41: ("time", ">fHf"), 0x45: ("software_version", ">10B"), 0x4A: ("position", ">fffff")}
_KINDS = {End.HOST: _HOST, End.MCU: _MCU}


class Tsip(Oracle):
    def encode(self, case: Case) -> bytes | None:
        number, layout = next((n, layout) for n, (name, layout) in _KINDS[case.sender].items() if name == case.message)
        flat = [n for value in case.wire for n in (value if isinstance(value, list) else [value])]
        return bytes(llapi.frame(llapi.stuff(bytes([number]) + struct.pack(layout, *flat))))

    def decode(self, frame: bytes, sender: End) -> Case | None:
        try:
            packet = llapi.unstuff(llapi.unframe(frame))
        except (ValueError, IndexError):
            return None
        known = _KINDS[sender].get(packet[0])
        if known is None or len(packet) - 1 != struct.calcsize(known[1]):
            return None
        wire: Wire = list(struct.unpack(known[1], packet[1:]))
        return Case(known[0], sender, [wire] if known[0] in ("software_version", "set_first_position") else wire)
