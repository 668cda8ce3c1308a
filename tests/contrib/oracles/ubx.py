"""UBX against pyubx2."""

from __future__ import annotations

from typing import Any

from pyubx2 import GET, UBXMessage, UBXMessageError, UBXParseError, UBXReader, UBXTypeError

from tests.contrib.oracle import Case, Oracle, Wire
from wirebond.protocol.model import End

# The library's class and name of each message, and the fields that are numbers of one type and no scale there.
_MESSAGES: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "nav_posllh": ("NAV", "NAV-POSLLH", ("iTOW", "lon", "lat", "height", "hMSL", "hAcc", "vAcc")),
    "nav_clock": ("NAV", "NAV-CLOCK", ("iTOW", "clkB", "clkD", "tAcc", "fAcc")),
    "cfg_rate": ("CFG", "CFG-RATE", ("measRate", "navRate", "timeRef")),
    "ack_ack": ("ACK", "ACK-ACK", ("clsID", "msgID")),
    "ack_nak": ("ACK", "ACK-NAK", ("clsID", "msgID")),
}
_NAMES = {identity: name for name, (_, identity, _) in _MESSAGES.items()}
_DEGREES = ("lon", "lat")  # numbers that the library scales


class Ubx(Oracle):
    def encode(self, case: Case) -> bytes | None:
        group, identity, names = _MESSAGES[case.message]
        numbers = list(divmod(case.wire[0], 256)) if group == "ACK" else case.wire
        given = {name: _scaled(name, number) for name, number in zip(names, numbers, strict=True)}
        return UBXMessage(group, identity, GET, **given).serialize()

    def decode(self, frame: bytes, sender: End) -> Case | None:
        try:
            message = UBXReader.parse(frame, msgmode=GET)
        except (UBXParseError, UBXMessageError, UBXTypeError, IndexError):
            return None
        name = _NAMES.get(message.identity)
        if name is None or message.serialize() != frame:
            return None
        wire: Wire = []
        for field in _MESSAGES[name][2]:
            number = getattr(message, field)
            wire.append(round(number * 1e7) if field in _DEGREES else number)
        return Case(name, sender, [wire[0] * 256 + wire[1]] if name.startswith("ack") else wire)


def _scaled(name: str, number: int) -> Any:
    """The library divides by its scale and cuts off: half a step more makes it the number that is meant."""
    return (number + (0.5 if number >= 0 else -0.5)) * 1e-7 if name in _DEGREES else number
