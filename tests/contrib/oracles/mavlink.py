"""MAVLink against pymavlink."""

from __future__ import annotations

import random
from typing import Any

from pymavlink.dialects.v20 import common

from tests.contrib.oracle import Case, Oracle, Wire
from wirebond.protocol.model import End, Message

_MESSAGES = {"heartbeat": 0, "attitude": 30, "command_long": 76, "command_ack": 77}
_ARRAYS = {"attitude": (1, 3, 3), "command_long": (7, 1, 1, 1, 1)}  # elements of each field; one where not listed
_NAMES = {number: name for name, number in _MESSAGES.items()}


class Mavlink(Oracle):
    def header(self, message: Message, source: random.Random) -> dict[str, int]:
        names = ("sequence", "system_id", "component_id")
        flags = {"incompat_flags": 0, "compat_flags": 0}  # the library sends no others
        return flags | {name: source.randrange(256) for name in names}

    def encode(self, case: Case) -> bytes | None:
        return pack(case)

    def decode(self, frame: bytes, sender: End) -> Case | None:
        try:
            message = common.MAVLink(None).decode(bytearray(frame))
        except (common.MAVError, IndexError, TypeError):
            return None
        name = _NAMES.get(message.get_msgId())
        if name is None or not isinstance(message, common.mavlink_map[_MESSAGES[name]]):
            return None
        head = message.get_header()
        header = {"sequence": head.seq, "system_id": head.srcSystem, "component_id": head.srcComponent}
        if frame[0] == 0xFD:
            header |= {"incompat_flags": head.incompat_flags, "compat_flags": head.compat_flags}
        return Case(name, sender, _grouped(name, [getattr(message, n) for n in message.ordered_fieldnames]), header)


def pack(case: Case, version_1: bool = False, secret: bytes | None = None) -> bytes:
    """The frame that pymavlink sends, of either version, signed if there is a secret."""
    header = case.header
    mav = common.MAVLink(None, srcSystem=header["system_id"], srcComponent=header["component_id"])
    mav.seq = header["sequence"]
    if secret is not None:
        mav.signing.secret_key, mav.signing.sign_outgoing = secret, True
    kind = common.mavlink_map[_MESSAGES[case.message]]
    flat = [n for value in case.wire for n in (value if isinstance(value, list) else [value])]
    message = kind(**dict(zip(kind.ordered_fieldnames, flat, strict=True)))
    return bytes(message.pack(mav, force_mavlink1=version_1))


def _grouped(name: str, flat: list[Any]) -> Wire:
    numbers = iter(flat)
    sizes = _ARRAYS.get(name, (1,) * len(flat))
    return [next(numbers) if size == 1 else [next(numbers) for _ in range(size)] for size in sizes]
