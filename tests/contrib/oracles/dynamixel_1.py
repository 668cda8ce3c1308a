"""Dynamixel protocol 1.0 against ROBOTIS' own dynamixel_sdk, on a port that is two byte strings."""

from __future__ import annotations

import random
from typing import Any

from dynamixel_sdk import COMM_SUCCESS, Protocol1PacketHandler

from tests.contrib.oracle import Case, Oracle
from tests.contrib.oracles.byte_port import ServoPort
from wirebond.protocol.model import End, Message

_INSTRUCTIONS = {1: "ping", 2: "read", 3: "write", 4: "write_later", 5: "action", 6: "factory_reset"}
_TO_SEVERAL = ("sync_write", "bulk_read")


class Dynamixel1(Oracle):
    def __init__(self) -> None:
        self._handler = Protocol1PacketHandler()

    def header(self, message: Message, source: random.Random) -> dict[str, int]:
        errors = {"id": source.randrange(128)} if message.name == "status" else {}
        return {"servo": 254 if message.name in _TO_SEVERAL else source.randrange(253), **errors}

    def values(self, message: Message, source: random.Random) -> dict[str, Any]:
        values = super().values(message, source)
        if message.name == "sync_write":  # the library's limit is 250 bytes, so is the file's; it wants whole servos
            values["size"] = source.randrange(1, 8)
            values["data"] = source.randbytes((values["size"] + 1) * source.randrange(1, 18))
        return values

    def encode(self, case: Case) -> bytes | None:
        port, servo, wire = ServoPort(), case.header["servo"], case.wire
        handler = self._handler
        if case.message == "ping":
            handler.ping(port, servo)
        elif case.message == "read":
            handler.readTx(port, servo, *wire)
        elif case.message == "write":
            handler.writeTxOnly(port, servo, wire[0], len(wire[1]), wire[1])
        elif case.message == "write_later":
            handler.regWriteTxOnly(port, servo, wire[0], len(wire[1]), wire[1])
        elif case.message == "action":
            handler.action(port, servo)
        elif case.message == "factory_reset":
            handler.factoryReset(port, servo)
        elif case.message == "sync_write":
            handler.syncWriteTxOnly(port, wire[0], wire[1], wire[2], len(wire[2]))
        elif case.message == "bulk_read":
            places = [number for read in wire[0] for number in read]
            handler.bulkReadTx(port, places, len(places))
        else:
            return None  # the library is the host's end
        return port.sent

    def reads(self, case: Case) -> bool:
        return (
            case.message not in _TO_SEVERAL
        )  # the library takes the instruction's place for error flags, 0x7F at most

    def decode(self, frame: bytes, sender: End) -> Case | None:
        port = ServoPort(frame)
        packet, result = self._handler.rxPacket(port)
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
