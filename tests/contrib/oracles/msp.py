"""MSP against pymsp, which knows both versions of the frame; the fields of the messages are packed here."""

from __future__ import annotations

import random
import struct
from typing import Any

from pymsp.msp import MSPException, MSPv1, MSPv2

from tests.contrib.oracle import Case, Oracle, Wire
from wirebond.protocol.model import End, Message

_REQUESTS = {1: "version", 102: "imu", 105: "channels", 108: "attitude", 109: "altitude", 110: "battery"}
# By id and sender: the message and its layout; * are 16-bit numbers to the end.
_HOST = {number: (f"read_{name}", "<") for number, name in _REQUESTS.items()}
_HOST |= {200: ("set_channels", "<*"), 0x1F03: ("set_air_speed", "<BIfh")}
_MCU = {
    1: ("version", "<BBB"), 102: ("imu", "<9h"), 105: ("channels", "<*"), 108: ("attitude", "<hhh"),
    109: ("altitude", "<ih"), 110: ("battery", "<BHHh"), 200: ("channels_set", "<"),
}  # fmt: skip
_KINDS = {End.HOST: _HOST, End.MCU: _MCU}
_MOST = 18  # channels


class Msp(Oracle):
    def header(self, message: Message, source: random.Random) -> dict[str, Any]:
        number = {"id": source.choice([*_MCU, 0x2001])} if message.name == "failed" else {}
        return {"flag": source.randrange(256), **number}

    def encode(self, case: Case) -> bytes | None:
        return pack(case)

    def decode(self, frame: bytes, sender: End) -> Case | None:
        parser = {b"$M": MSPv1, b"$X": MSPv2}.get(frame[:2])
        starts = (b"$M<", b"$X<") if sender == End.HOST else (b"$M>", b"$X>", b"$M!", b"$X!")
        if parser is None or frame[:3] not in starts:
            return None
        is_error = frame[2:3] == b"!"  # no check covers the direction, and the library reads replies only
        plain = frame[:2] + b">" + frame[3:] if is_error else frame
        try:
            found = parser().unpack(plain)
        except (MSPException, IndexError):
            return None
        if found.to_bytes() != plain:
            return None  # the library leaves what follows
        if is_error:
            header = {"flag": found.flags[0], "id": found.message_id} if found.flags else {"id": found.message_id}
            return Case("failed", sender, [], header) if not found.payload else None
        known = _KINDS[sender].get(found.message_id)
        if known is None:
            return None
        name, layout = known
        layout = layout.replace("*", f"{len(found.payload) // 2}H")
        if len(found.payload) != struct.calcsize(layout) or ("H" in known[1] and len(found.payload) > 255):
            return None
        wire: Wire = list(struct.unpack(layout, found.payload))
        if "*" in known[1]:
            if len(wire) > _MOST:
                return None
            wire = [wire]
        if name == "imu":
            wire = [wire[:3], wire[3:6], wire[6:]]
        return Case(name, sender, wire, {"flag": found.flags[0]} if found.flags else {})


def pack(case: Case, version_1: bool = False) -> bytes:
    """The frame that pymsp sends, of either version. It only sends as a host, so of a reply it sets the direction."""
    if case.message == "failed":
        number, flag = case.header["id"], bytes([case.header["flag"]])
        packed = MSPv1().pack(number, b"") if version_1 else MSPv2().pack(number, b"", flag)
        return packed[:2] + b"!" + packed[3:]
    number, layout = next((n, layout) for n, (name, layout) in _KINDS[case.sender].items() if name == case.message)
    flat = [n for value in case.wire for n in (value if isinstance(value, list) else [value])]
    payload = struct.pack(layout.replace("*", f"{len(flat)}H"), *flat)
    flag = bytes([case.header["flag"]])
    packed = MSPv1().pack(number, payload) if version_1 else MSPv2().pack(number, payload, flag)
    return packed if case.sender == End.HOST else packed[:2] + b">" + packed[3:]
