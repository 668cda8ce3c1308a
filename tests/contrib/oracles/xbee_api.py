"""XBee API frames of both modes against Digi's own digi-xbee."""

from __future__ import annotations

import random
from typing import Any

from digi.xbee.exception import InvalidPacketException
from digi.xbee.models.address import XBee16BitAddress, XBee64BitAddress
from digi.xbee.models.status import ATCommandStatus, DiscoveryStatus, ModemStatus, TransmitStatus
from digi.xbee.packets import common, factory, raw
from digi.xbee.packets.base import XBeeAPIPacket

from tests.contrib.oracle import Case, Oracle
from wirebond.protocol.model import End, Message

_MODEM = [status.code for status in ModemStatus if status != ModemStatus.UNKNOWN]
_DELIVERY = [status.code for status in TransmitStatus if status != TransmitStatus.UNKNOWN]


class XbeeApi(Oracle):
    def __init__(self, escaped: bool = False) -> None:
        self._escaped = escaped

    def values(self, message: Message, source: random.Random) -> dict[str, Any]:
        values = super().values(message, source)
        if "command" in values:
            values["command"] = "".join(source.choices("ABCDHILNOPR%", k=2))
        if message.name == "modem_status":
            values["status"] = source.choice(_MODEM)
        if message.name == "transmitted":
            values["status"] = source.choice(_DELIVERY)
        if message.name == "transmit_status":
            values["delivery"] = source.choice(_DELIVERY)
        return values

    def encode(self, case: Case) -> bytes | None:
        wire = [bytearray(value) if isinstance(value, bytes) else value for value in case.wire]
        if case.message == "at_command":
            packet = common.ATCommPacket(*wire)
        elif case.message == "transmit_64":
            packet = raw.TX64Packet(wire[0], _wide(wire[1]), *wire[2:])
        elif case.message == "transmit_16":
            packet = raw.TX16Packet(wire[0], _narrow(wire[1]), *wire[2:])
        elif case.message == "transmitted":
            packet = raw.TXStatusPacket(wire[0], TransmitStatus.get(wire[1]))
        elif case.message == "received_64":
            packet = raw.RX64Packet(_wide(wire[0]), *wire[1:])
        elif case.message == "received_16":
            packet = raw.RX16Packet(_narrow(wire[0]), *wire[1:])
        elif case.message == "at_command_queued":
            packet = common.ATCommQueuePacket(*wire)
        elif case.message == "remote_at_command":
            packet = common.RemoteATCommandPacket(wire[0], _wide(wire[1]), _narrow(wire[2]), *wire[3:])
        elif case.message == "remote_at_response":
            status = ATCommandStatus.get(wire[4])
            packet = common.RemoteATCommandResponsePacket(
                wire[0], _wide(wire[1]), _narrow(wire[2]), wire[3], status, wire[5]
            )
        elif case.message == "transmit_request":
            packet = common.TransmitPacket(wire[0], _wide(wire[1]), _narrow(wire[2]), *wire[3:])
        elif case.message == "at_response":
            packet = common.ATCommResponsePacket(*wire)
        elif case.message == "modem_status":
            packet = common.ModemStatusPacket(ModemStatus.get(wire[0]))
        elif case.message == "transmit_status":
            delivery, discovery = TransmitStatus.get(wire[3]), DiscoveryStatus.get(wire[4])
            packet = common.TransmitStatusPacket(wire[0], _narrow(wire[1]), wire[2], delivery, discovery)
        else:
            packet = common.ReceivePacket(_wide(wire[0]), _narrow(wire[1]), *wire[2:])
        return bytes(packet.output(self._escaped))

    def reads(self, case: Case) -> bool:
        return case.message not in ("transmit_64", "transmit_16")

    def decode(self, frame: bytes, sender: End) -> Case | None:
        try:
            plain = XBeeAPIPacket.unescape_data(frame) if self._escaped else bytearray(frame)
            packet = factory.build_frame(plain)
        except (InvalidPacketException, ValueError, IndexError):
            return None
        if bytes(packet.output(self._escaped)) != frame:
            return None
        if isinstance(packet, common.ATCommPacket | common.ATCommQueuePacket):
            wire = [packet.frame_id, packet.command.encode(), bytes(packet.parameter or b"")]
            name = "at_command" if isinstance(packet, common.ATCommPacket) else "at_command_queued"
            return Case(name, sender, wire)
        if isinstance(packet, raw.TXStatusPacket):
            return Case("transmitted", sender, [packet.frame_id, packet.transmit_status.code])
        if isinstance(packet, raw.RX64Packet | raw.RX16Packet):
            is_wide = isinstance(packet, raw.RX64Packet)
            by = packet.x64bit_source_addr if is_wide else packet.x16bit_source_addr
            wire = [int.from_bytes(by.address, "big"), packet.rssi, packet.receive_options]
            return Case("received_64" if is_wide else "received_16", sender, [*wire, bytes(packet.rf_data or b"")])
        if isinstance(packet, common.RemoteATCommandPacket):
            wire = [packet.frame_id, *_addresses(packet), packet.transmit_options, packet.command.encode()]
            return Case("remote_at_command", sender, [*wire, bytes(packet.parameter or b"")])
        if isinstance(packet, common.RemoteATCommandResponsePacket):
            wide = int.from_bytes(packet.x64bit_source_addr.address, "big")
            narrow = int.from_bytes(packet.x16bit_source_addr.address, "big")
            wire = [packet.frame_id, wide, narrow, packet.command.encode(), packet.real_status]
            return Case("remote_at_response", sender, [*wire, bytes(packet.command_value or b"")])
        if isinstance(packet, common.TransmitPacket):
            wire = [packet.frame_id, *_addresses(packet), packet.broadcast_radius, packet.transmit_options]
            return Case("transmit_request", sender, [*wire, bytes(packet.rf_data or b"")])
        if isinstance(packet, common.ATCommResponsePacket):
            wire = [packet.frame_id, packet.command.encode(), packet.real_status, bytes(packet.command_value or b"")]
            return Case("at_response", sender, wire)
        if isinstance(packet, common.ModemStatusPacket):
            return Case("modem_status", sender, [packet.modem_status.code])
        if isinstance(packet, common.TransmitStatusPacket):
            address = int.from_bytes(packet.x16bit_dest_addr.address, "big")
            status = [packet.transmit_status.code, packet.discovery_status.code]
            return Case("transmit_status", sender, [packet.frame_id, address, packet.transmit_retry_count, *status])
        if isinstance(packet, common.ReceivePacket):
            wide = int.from_bytes(packet.x64bit_source_addr.address, "big")
            narrow = int.from_bytes(packet.x16bit_source_addr.address, "big")
            wire = [wide, narrow, packet.receive_options, bytes(packet.rf_data or b"")]
            return Case("receive_packet", sender, wire)
        return None


def _wide(number: int) -> XBee64BitAddress:
    return XBee64BitAddress(bytearray(number.to_bytes(8, "big")))


def _narrow(number: int) -> XBee16BitAddress:
    return XBee16BitAddress(bytearray(number.to_bytes(2, "big")))


def _addresses(packet: common.TransmitPacket | common.RemoteATCommandPacket) -> list[int]:
    pair = (packet.x64bit_dest_addr, packet.x16bit_dest_addr)
    return [int.from_bytes(address.address, "big") for address in pair]
