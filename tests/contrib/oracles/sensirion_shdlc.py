"""SHDLC against Sensirion's own driver, which writes what the host sends and reads what the device answers."""

from __future__ import annotations

import random
import struct
from typing import Any

from sensirion_shdlc_driver.errors import ShdlcResponseError
from sensirion_shdlc_driver.serial_frame_builder import ShdlcSerialMisoFrameBuilder, ShdlcSerialMosiFrameBuilder

from tests.contrib.oracle import Case, Oracle, Wire
from wirebond.protocol.model import End, Message

_HOST = {
    "start_measurement": (0x00, ">BB"), "stop_measurement": (0x01, ">"), "read_measurement": (0x03, ">"),
    "set_interval": (0x80, ">BI"), "read_version": (0xD1, ">"), "set_address": (0x90, ">B"),
    "read_address": (0x90, ">"), "set_baud": (0x91, ">I"), "read_baud": (0x91, ">"), "factory_reset": (0x92, ">"),
    "read_up_time": (0x93, ">"), "set_reply_delay": (0x95, ">H"), "read_reply_delay": (0x95, ">"),
    "read_information": (0xD0, ">B"), "read_error_state": (0xD2, ">B"), "reset": (0xD3, ">"),
}  # fmt: skip
_MCU = {
    0x00: {"started": ">"}, 0x01: {"stopped": ">"}, 0x03: {"measurement": ">10f"}, 0x80: {"interval_set": ">"},
    0x90: {"address_set": ">", "address": ">B"}, 0x91: {"baud_set": ">", "baud": ">I"}, 0x92: {"factory_set": ">"},
    0x93: {"up_time": ">I"}, 0x95: {"reply_delay_set": ">", "reply_delay": ">H"}, 0xD1: {"version": ">7B"},
    0xD2: {"error_state": ">IB"}, 0xD3: {"resetting": ">"},
}  # fmt: skip
_INFORMATION = 0xD0  # a text


class SensirionShdlc(Oracle):
    def header(self, message: Message, source: random.Random) -> dict[str, Any]:
        header = {"device": source.randrange(255)}
        return header | ({"state": source.randrange(256)} if message.sender == End.MCU else {})

    def encode(self, case: Case) -> bytes | None:
        if case.sender == End.MCU:
            return None  # the library is the host's end
        number, layout = _HOST[case.message]
        data = struct.pack(layout, *case.wire)
        return bytes(ShdlcSerialMosiFrameBuilder(case.header["device"], number, data).to_bytes())

    def reads(self, case: Case) -> bool:
        return case.sender == End.MCU

    def decode(self, frame: bytes, sender: End) -> Case | None:
        if sender == End.HOST or frame[-1:] != b"\x7e" or b"\x7e" in frame[:-1].removeprefix(b"\x7e"):
            return None  # the library is given one frame
        builder = ShdlcSerialMisoFrameBuilder()
        builder.add_data(b"\x7e" + frame.removeprefix(b"\x7e"))
        try:
            device, number, state, data = builder.interpret_data()
        except ShdlcResponseError:
            return None
        if not _is_stuffed(frame):
            return None
        header = {"device": device, "state": state}
        if number == _INFORMATION:
            return Case("information", sender, [bytes(data)], header)
        kinds = _MCU.get(number, {}).items()
        name, layout = next((kind for kind in kinds if struct.calcsize(kind[1]) == len(data)), ("", ""))
        if not name:
            return None
        wire: Wire = list(struct.unpack(layout, data))
        if name == "measurement":
            wire = [wire[:4], wire[4:9], wire[9]]
        if name == "version":
            wire = [wire[:2], *wire[2:5], wire[5:]]
        return Case(name, sender, wire, header)


def _is_stuffed(frame: bytes) -> bool:
    """The library takes several escapes for one, one in front of any byte, and one that nothing follows."""
    pairs = [frame[i : i + 2] for i, byte in enumerate(frame) if byte == 0x7D]
    return all(len(pair) == 2 and pair[1] ^ 0x20 in (0x7E, 0x7D, 0x11, 0x13) for pair in pairs)
