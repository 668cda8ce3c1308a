"""LX-16A against lewanlib, whose frame is the same in both directions."""

from __future__ import annotations

import random
import struct

from lewanlib.bus import ServoBus

from tests.contrib.oracle import Case, Oracle, Wire
from tests.contrib.oracles.byte_port import BytePort
from wirebond.protocol.model import End, Message

# By id and sender: the message and the layout of its parameters, which the library leaves to its callers.
_HOST = {
    1: ("move", "<HH"), 7: ("move_later", "<HH"), 11: ("start", "<"), 12: ("stop", "<"), 13: ("set_number", "<B"),
    17: ("adjust_offset", "<b"), 18: ("save_offset", "<"), 29: ("set_mode", "<Bxh"), 31: ("power", "<B"),
    35: ("set_alarms", "<B"), 2: ("read_move", "<"), 26: ("read_temperature", "<"), 27: ("read_voltage", "<"),
    28: ("read_angle", "<"), 36: ("read_alarms", "<"), 8: ("read_move_later", "<"), 14: ("read_number", "<"),
    19: ("read_offset", "<"), 20: ("set_angle_limits", "<HH"), 21: ("read_angle_limits", "<"),
    22: ("set_voltage_limits", "<HH"), 23: ("read_voltage_limits", "<"), 24: ("set_temperature_limit", "<B"),
    25: ("read_temperature_limit", "<"), 30: ("read_mode", "<"), 32: ("read_power", "<"), 33: ("set_light", "<B"),
    34: ("read_light", "<"),
}  # fmt: skip
_MCU = {
    2: ("last_move", "<HH"), 26: ("temperature", "<B"), 27: ("voltage", "<H"), 28: ("angle", "<h"),
    36: ("alarms", "<B"), 8: ("waiting_move", "<HH"), 14: ("number", "<B"), 19: ("offset", "<b"),
    21: ("angle_limits", "<HH"), 23: ("voltage_limits", "<HH"), 25: ("temperature_limit", "<B"), 30: ("mode", "<Bxh"),
    32: ("power_state", "<B"), 34: ("light", "<B"),
}  # fmt: skip
_KINDS = {End.HOST: _HOST, End.MCU: _MCU}


class Lx16a(Oracle):
    def header(self, message: Message, source: random.Random) -> dict[str, int]:
        return {"servo": source.randrange(255)}

    def encode(self, case: Case) -> bytes | None:
        kinds = {name: (number, layout) for number, (name, layout) in _KINDS[case.sender].items()}
        number, layout = kinds[case.message]
        port = BytePort()
        _bus(port)._send_packet(case.header["servo"], number, struct.pack(layout, *case.wire))
        return port.sent

    def decode(self, frame: bytes, sender: End) -> Case | None:
        port = BytePort(frame)
        try:
            servo, number, parameters = _bus(port)._receive_packet()
            name, layout = _KINDS[sender][number]
            wire: Wire = list(struct.unpack(layout, parameters))
        except Exception:  # what the library raises on anything it cannot read; KeyError, struct.error
            return None
        # The library finds a frame anywhere, takes padding with any value, and a length that is too small for one.
        if port.received or frame[:2] != b"\x55\x55" or len(frame) != 6 + len(parameters):
            return None
        return Case(name, sender, wire, {"servo": servo})


def _bus(port: BytePort) -> ServoBus:
    return ServoBus(serial_conn=port, discard_echo=False)
