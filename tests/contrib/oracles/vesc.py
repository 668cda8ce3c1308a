"""VESC against pyvesc-fix, which has the messages of newer firmware than pyvesc."""

from __future__ import annotations

import importlib.util
import struct
import sys
import types
import warnings
from typing import Any

from tests.contrib.oracle import Case, Oracle, Wire
from wirebond.protocol.model import End

# The package calls itself by the name of the one that it comes from.
_found = importlib.util.find_spec("pyvesc_fix")
assert _found is not None
_package = types.ModuleType("pyvesc")
_package.__path__ = list(_found.submodule_search_locations or [])
sys.modules["pyvesc"] = _package
with warnings.catch_warnings():
    warnings.simplefilter("ignore", SyntaxWarning)  # it compares numbers with `is`
    from pyvesc.protocol.base import VESCMessage
    from pyvesc.protocol.interface import encode_request
    from pyvesc.protocol.packet.codec import frame as framed
    from pyvesc.protocol.packet.codec import unframe
    from pyvesc.VESC import VESC  # noqa: F401, the dialogues drive it
    from pyvesc.VESC.messages import getters, setters

_KINDS: dict[str, tuple[Any, int]] = {  # by message: the library's class, its number
    "set_duty_cycle": (setters.SetDutyCycle, 5),
    "set_current": (setters.SetCurrent, 6),
    "set_brake_current": (setters.SetCurrentBrake, 7),
    "set_speed": (setters.SetRPM, 8),
    "set_position": (setters.SetPosition, 9),
    "show_position": (setters.SetRotorPositionMode, 11),
    "set_servo": (setters.SetServoPosition, 12),
    "rotor_position": (getters.GetRotorPosition, 22),
    "values": (getters.GetValues, 4),
}
_TEXTS = {"terminal_command": 20, "print": 21, "alive": 30}  # framed by the library, whose messages have no long one
_NAMES = {(End.HOST, number): name for name, (_, number) in _KINDS.items() if name not in ("values", "rotor_position")}
_NAMES |= {(End.MCU, 4): "values", (End.MCU, 22): "rotor_position", (End.HOST, 4): "get_values"}


class Vesc(Oracle):
    def encode(self, case: Case) -> bytes | None:
        if case.message == "get_values":
            return encode_request(getters.GetValues)
        if case.message == "read_version":
            return encode_request(getters.GetVersion)
        if case.message == "version":
            return framed(bytes([0, *case.wire[:2]]) + case.wire[2])
        if case.message in _TEXTS:
            return framed(bytes([_TEXTS[case.message]]) + b"".join(case.wire))
        if case.message == "values":
            return None  # the library reads the bytes among its numbers and cannot write them
        kind, _ = _KINDS[case.message]
        scales = [field[2] if len(field) == 3 else 1 for field in kind.fields]
        return framed(VESCMessage.pack(kind(*map(_given, case.wire, scales))))

    def decode(self, frame: bytes, sender: End) -> Case | None:
        try:
            payload, consumed = unframe(frame, errors="strict")
        except Exception:  # what the library raises on a wrong checksum, start or end
            return None
        if not payload or consumed != len(frame):
            return None
        number, fields = payload[0], payload[1:]
        if number == 0:
            if sender == End.HOST:
                return Case("read_version", sender, []) if not fields else None
            return Case("version", sender, [*fields[:2], fields[2:]]) if len(fields) >= 2 else None
        if number in _TEXTS.values():
            name = next(n for n, code in _TEXTS.items() if code == number)
            if (name == "print") != (sender == End.MCU) or (name == "alive" and fields):
                return None
            return Case(name, sender, [fields] if name != "alive" else [])
        name = _NAMES.get((sender, number), "")
        if name in ("", "get_values"):
            return Case(name, sender, []) if name and not fields else None
        try:
            message = VESCMessage.unpack(payload)
        except struct.error:
            return None
        kind, _ = _KINDS[name]
        size = struct.calcsize(">" + kind._fmt_fields)
        if len(fields) < size or (len(fields) > size and name != "values"):
            return None
        wire: Wire = []
        for field in kind.fields:
            value, scale = getattr(message, field[0]), field[2] if len(field) == 3 else 1
            wire.append(value[0] if isinstance(value, bytes) else round(value * (scale or 1)))
        if name == "values":
            # the library takes the last two temperatures for one number, a time
            wire[-1] = list(struct.unpack(">hh", struct.pack(">i", wire[-1])))
            wire.append(fields[size:])
        return Case(name, sender, wire)


def _given(number: int, scale: int) -> Any:
    """The library multiplies with its scale and cuts off: half a step more makes it the number that is meant."""
    return number if scale == 1 else (number + (0.5 if number >= 0 else -0.5)) / scale
