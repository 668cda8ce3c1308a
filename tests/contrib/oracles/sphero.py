"""Sphero's API v2 against spherov2, which knows the packet; the fields of the messages are packed here."""

from __future__ import annotations

import random
import struct
from typing import Any

from spherov2.controls import PacketDecodingException
from spherov2.controls.v2 import Packet

from tests.contrib.oracle import Case, Oracle, Wire
from wirebond.protocol.model import End, Message

_FLAGS = ("response", "wants_response", "wants_errors_only", "activity", "has_target", "has_source")
# By id and sender: the message and its layout; what is left of the payload is bytes.
_HOST = {
    0x1000: ("ping", ">*"), 0x130D: ("wake", ">"), 0x1301: ("sleep", ">"), 0x1303: ("read_battery", ">"),
    0x1607: ("drive", ">BHB"), 0x1606: ("reset_heading", ">"), 0x1A0E: ("set_light", ">H*"),
}  # fmt: skip
_MCU = {
    0x1000: ("pong", ">*"), 0x1303: ("battery", ">H"), 0x1812: ("collision", ">hhhBhhhBI"),
    0x130D: ("woken", ">"), 0x1301: ("falling_asleep", ">"), 0x1607: ("driving", ">"), 0x1606: ("heading_reset", ">"),
    0x1A0E: ("light_set", ">"),
}  # fmt: skip
_MOST = {"ping": 16, "pong": 16, "set_light": 48}  # bytes that are left of a payload; the format itself has no limit
_KINDS = {End.HOST: _HOST, End.MCU: _MCU}


class Sphero(Oracle):
    def header(self, message: Message, source: random.Random) -> dict[str, Any]:
        flags = [flag for flag in _FLAGS[1:] if source.random() < 0.5]
        header: dict[str, Any] = {"number": source.randrange(256)}
        if message.sender == End.MCU and source.random() < 0.5:
            flags.append("response")
            header["error"] = source.choice(list(Packet.Error)).name
        for name in ("target", "source"):
            if f"has_{name}" in flags:
                header[name] = source.randrange(256)
        return header | {"flags": [flag for flag in _FLAGS if flag in flags]}

    def encode(self, case: Case) -> bytes | None:
        kinds = {name: (number, layout) for number, (name, layout) in _KINDS[case.sender].items()}
        number, layout = kinds[case.message]
        flat = [n for value in case.wire for n in (value if isinstance(value, list) else [value])]
        data = flat.pop() if layout.endswith("*") else b""
        header = case.header
        packet = Packet(
            Packet.Flags(sum(1 << _FLAGS.index(flag) for flag in header["flags"])),
            number >> 8,
            number & 0xFF,
            header["number"],
            header.get("target"),
            header.get("source"),
            bytearray(struct.pack(layout.rstrip("*"), *flat) + data),
            Packet.Error[header["error"]] if "error" in header else None,
        )
        return bytes(packet.build())

    def decode(self, frame: bytes, sender: End) -> Case | None:
        if len(frame) < 6 or 0x8D in frame[1:] or 0xD8 in frame[:-1]:
            return None  # the library is given one packet
        try:
            packet = Packet.parse_response(frame)
        except (PacketDecodingException, ValueError, IndexError):
            return None
        found = _KINDS[sender].get(packet.did << 8 | packet.cid)
        if found is None or packet.flags >> 6:
            return None
        name, layout = found
        data, fixed = bytes(packet.data), struct.calcsize(layout.rstrip("*"))
        if not fixed <= len(data) <= fixed + _MOST.get(name, 0):
            return None
        wire: Wire = list(struct.unpack_from(layout.rstrip("*"), data))
        if name == "collision":
            wire = [wire[:3], wire[3], wire[4:7], *wire[7:]]
        header: dict[str, Any] = {
            "flags": [f for i, f in enumerate(_FLAGS) if packet.flags >> i & 1],
            "number": packet.seq,
        }
        header |= {"target": packet.tid} if packet.tid is not None else {}
        header |= {"source": packet.sid} if packet.sid is not None else {}
        header |= {"error": packet.err.name} if packet.flags & Packet.Flags.is_response else {}
        return Case(name, sender, wire + ([data[fixed:]] if layout.endswith("*") else []), header)
