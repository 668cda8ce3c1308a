"""Dynamixel protocol 2.0 against ROBOTIS' own dynamixel_sdk, on a port that is two byte strings."""

from __future__ import annotations

import random
from typing import Any

from dynamixel_sdk import COMM_SUCCESS, Protocol2PacketHandler

from tests.contrib.oracle import Case, Oracle
from tests.contrib.oracles.byte_port import ServoPort
from wirebond.protocol.model import End, Message

_TO_SEVERAL = ("sync_write", "sync_read", "fast_sync_read", "bulk_read", "fast_bulk_read", "bulk_write")
_STUFFED = b"\xff\xff\xfd"


class _Handler(Protocol2PacketHandler):
    """The library stuffs a copy, and then sends the packet without it. Here it sends what it stuffed."""

    def addStuffing(self, packet: list[int]) -> list[int]:  # noqa: N802
        packet[:] = super().addStuffing(packet)
        return packet


class Dynamixel2(Oracle):
    def __init__(self) -> None:
        self._handler = _Handler()

    def header(self, message: Message, source: random.Random) -> dict[str, Any]:
        return {"servo": 254 if message.name in _TO_SEVERAL else source.randrange(253)}

    def values(self, message: Message, source: random.Random) -> dict[str, Any]:
        values = super().values(message, source)
        if message.name == "status":  # the library loses its place behind the first byte that it takes out
            values["data"] = source.randbytes(source.randrange(20)).replace(b"\xff", b"") + source.choice(
                [b"", _STUFFED]
            )
        elif "data" in values:
            pieces = [_STUFFED, b"\xff", b"\xfd", source.randbytes(3)]
            values["data"] = b"".join(source.choices(pieces, k=source.randrange(20)))
        if message.name == "sync_write":  # the library wants whole servos
            values["size"] = source.randrange(1, 8)
            values["data"] = source.randbytes((values["size"] + 1) * source.randrange(1, 30))
        return values

    def encode(self, case: Case) -> bytes | None:
        port, servo, wire, handler = ServoPort(), case.header["servo"], case.wire, self._handler
        if case.message == "ping":
            handler.ping(port, servo)
        elif case.message == "read":
            handler.readTx(port, servo, *wire)
        elif case.message == "write":
            handler.writeTxOnly(port, servo, wire[0], len(wire[1]), list(wire[1]))
        elif case.message == "write_later":
            handler.regWriteTxOnly(port, servo, wire[0], len(wire[1]), list(wire[1]))
        elif case.message == "action":
            handler.action(port, servo)
        elif case.message == "factory_reset":
            handler.factoryReset(port, servo, wire[0])
        elif case.message == "reboot":
            handler.reboot(port, servo)
        elif case.message == "clear_turns":
            handler.clearMultiTurn(port, servo)
        elif case.message in ("sync_read", "fast_sync_read"):
            is_fast = case.message == "fast_sync_read"
            handler.syncReadTx(port, wire[0], wire[1], wire[2], len(wire[2]), is_fast)
        elif case.message in ("bulk_read", "fast_bulk_read"):
            places = [n for one, at, size in wire[0] for n in (one, at & 0xFF, at >> 8, size & 0xFF, size >> 8)]
            handler.bulkReadTx(port, places, len(places), case.message == "fast_bulk_read")
        elif case.message == "bulk_write":
            handler.bulkWriteTxOnly(port, list(wire[0]), len(wire[0]))
        elif case.message == "sync_write":
            handler.syncWriteTxOnly(port, wire[0], wire[1], list(wire[2]), len(wire[2]))
        else:
            return None  # the library is the host's end
        return port.sent

    def reads(self, case: Case) -> bool:
        return case.sender == End.MCU  # the library reads nothing but status packets

    def decode(self, frame: bytes, sender: End) -> Case | None:
        port = ServoPort(frame)
        packet, result = self._handler.rxPacket(port, False)
        size = len(frame) - 7
        if sender == End.HOST or result != COMM_SUCCESS or port.received or frame[5:7] != size.to_bytes(2, "little"):
            return None  # the library finds a frame behind other bytes
        end = 7 + int.from_bytes(bytes(packet[5:7]), "little") - 2
        error, data = packet[8], bytes(packet[9:end])
        return Case("status", sender, [[error & 0x7F, error >> 7], data], {"servo": packet[4]})
