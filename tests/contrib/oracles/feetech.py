"""Feetech's servos against their own scservo_sdk, on a port that is two byte strings."""

from __future__ import annotations

import random
from typing import Any

from scservo_sdk import COMM_SUCCESS, protocol_packet_handler

from tests.contrib.oracle import Case, Oracle
from tests.contrib.oracles.byte_port import ServoPort
from wirebond.protocol.model import End, Message

_INSTRUCTIONS = {1: "ping", 2: "read", 3: "write", 4: "write_later", 5: "action", 0x82: "sync_read"}
_LITTLE_ENDIAN = 0


class Feetech(Oracle):
    def header(self, message: Message, source: random.Random) -> dict[str, int]:
        faults = {"id": source.randrange(128)} if message.name == "status" else {}
        return {"servo": 254 if message.name.startswith("sync") else source.randrange(253), **faults}

    def values(self, message: Message, source: random.Random) -> dict[str, Any]:
        values = super().values(message, source)
        if message.name == "sync_write":  # the library wants whole servos
            values["size"] = source.randrange(1, 8)
            values["data"] = source.randbytes((values["size"] + 1) * source.randrange(1, 30))
        return values

    def encode(self, case: Case) -> bytes | None:
        port, servo, wire = ServoPort(), case.header["servo"], case.wire
        handler = protocol_packet_handler(port, _LITTLE_ENDIAN)
        if case.message == "ping":
            handler.ping(servo)
        elif case.message == "read":
            handler.readTx(servo, *wire)
        elif case.message == "write":
            handler.writeTxOnly(servo, wire[0], len(wire[1]), wire[1])
        elif case.message == "write_later":
            handler.regWriteTxOnly(servo, wire[0], len(wire[1]), wire[1])
        elif case.message == "action":
            handler.action(servo)
        elif case.message == "sync_read":
            handler.syncReadTx(wire[0], wire[1], wire[2], len(wire[2]))
        elif case.message == "sync_write":
            handler.syncWriteTxOnly(wire[0], wire[1], wire[2], len(wire[2]))
        else:
            return None  # the library is the host's end
        return port.sent

    def reads(self, case: Case) -> bool:
        return not case.message.startswith("sync")  # what is 0x80 or more is not a status to the library

    def decode(self, frame: bytes, sender: End) -> Case | None:
        packet, result = protocol_packet_handler(ServoPort(frame), _LITTLE_ENDIAN).rxPacket()
        if result != COMM_SUCCESS or bytes(packet) != frame:
            return None
        code, parameters = packet[4], bytes(packet[5:-1])
        header = {"servo": packet[2]}
        if sender == End.MCU:
            return Case("status", sender, [parameters], {**header, "id": code})  # the error flags
        name = _INSTRUCTIONS.get(code, "unknown")
        if name in ("write", "write_later"):
            return Case(name, sender, [parameters[0], parameters[1:]], header)
        return Case(name, sender, list(parameters), header)
