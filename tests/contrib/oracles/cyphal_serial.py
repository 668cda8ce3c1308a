"""Cyphal/serial against pycyphal, which knows the frame and the CRC of a transfer; the fields are packed here."""

from __future__ import annotations

import random
import struct
from typing import Any

from pycyphal.transport import MessageDataSpecifier, Priority, ServiceDataSpecifier
from pycyphal.transport.commons.crc import CRC32C
from pycyphal.transport.serial._frame import SerialFrame

from tests.contrib.oracle import Case, Oracle, Wire
from wirebond.protocol.model import End, Message

_SUBJECTS = {7509: "heartbeat"}
_REQUESTS = {430: "get_info", 435: "execute_command"}
_RESPONSES = {430: "info", 435: "command_executed"}
_LAYOUTS = {
    "heartbeat": "<IBBB",
    "get_info": "<",
    "command_executed": "<B",
    "info": "<2B2B2BQ16s",
    "execute_command": "<H",
}
_ROLES = ServiceDataSpecifier.Role
_PRIORITIES = [priority.name.lower() for priority in sorted(Priority)]
_BROADCAST = 0xFFFF


class CyphalSerial(Oracle):
    def header(self, message: Message, source: random.Random) -> dict[str, Any]:
        return {
            "priority": source.choice(_PRIORITIES),
            "source": source.randrange(_BROADCAST),
            "destination": source.choice([_BROADCAST, source.randrange(_BROADCAST)]),
            "transfer": source.choice([0, 2**64 - 1, source.randrange(2**64)]),
        }

    def encode(self, case: Case) -> bytes | None:
        name = case.message
        kind: MessageDataSpecifier | ServiceDataSpecifier
        if name in _SUBJECTS.values():
            kind = MessageDataSpecifier(_number(_SUBJECTS, name))
        elif name in _REQUESTS.values():
            kind = ServiceDataSpecifier(_number(_REQUESTS, name), _ROLES.REQUEST)
        else:
            kind = ServiceDataSpecifier(_number(_RESPONSES, name), _ROLES.RESPONSE)
        payload = _packed(name, case.wire)
        destination = case.header["destination"]
        frame = SerialFrame(
            priority=Priority[str(case.header["priority"]).upper()],
            transfer_id=case.header["transfer"],
            index=0,
            end_of_transfer=True,
            payload=memoryview(payload + CRC32C.new(payload).value_as_bytes),
            source_node_id=case.header["source"],
            destination_node_id=None if destination == _BROADCAST else destination,
            data_specifier=kind,
            user_data=0,
        )
        return bytes(frame.compile_into(bytearray(2 * len(payload) + 100)))

    def decode(self, frame: bytes, sender: End) -> Case | None:
        if frame[-1:] != b"\0" or b"\0" in frame[:-1].removeprefix(b"\0"):
            return None  # the library is given what lies between two delimiters
        found = SerialFrame.parse_from_cobs_image(memoryview(frame))
        if found is None or found.index != 0 or not found.end_of_transfer or found.source_node_id is None:
            return None
        if not CRC32C.new(found.payload).check_residue():
            return None
        kind = found.data_specifier
        if isinstance(kind, MessageDataSpecifier):
            name = _SUBJECTS.get(kind.subject_id)
        else:
            name = (_REQUESTS if kind.role == _ROLES.REQUEST else _RESPONSES).get(kind.service_id)
        wire = None if name is None else _unpacked(name, bytes(found.payload[:-4]))
        if name is None or wire is None:
            return None
        destination = _BROADCAST if found.destination_node_id is None else found.destination_node_id
        header = {"priority": found.priority.name.lower(), "source": found.source_node_id, "destination": destination}
        return Case(name, sender, wire, header | {"transfer": found.transfer_id})


def _number(names: dict[int, str], name: str) -> int:
    return next(number for number, known in names.items() if known == name)


def _packed(name: str, wire: Wire) -> bytes:
    if name == "execute_command":
        return struct.pack("<HB", wire[0], len(wire[1])) + wire[1]
    if name == "info":
        *fixed, text, checks, certificate = wire
        flat = [n for value in fixed for n in (value if isinstance(value, list) else [value])]
        payload = struct.pack(_LAYOUTS[name], *flat) + bytes([len(text)]) + text
        payload += bytes([len(checks)]) + b"".join(check.to_bytes(8, "little") for check in checks)
        return payload + bytes([len(certificate)]) + certificate
    return struct.pack(_LAYOUTS[name], *wire)


def _unpacked(name: str, payload: bytes) -> Wire | None:
    fixed = struct.calcsize(_LAYOUTS[name])
    if len(payload) < fixed:
        return None
    wire: Wire = list(struct.unpack_from(_LAYOUTS[name], payload))
    rest = payload[fixed:]
    if name == "info":
        wire = [wire[0:2], wire[2:4], wire[4:6], *wire[6:]]
        text, rest = rest[1 : 1 + rest[0]], rest[1 + rest[0] :]
        size = 1 + 8 * rest[0]
        wire += [text, [int.from_bytes(rest[i : i + 8], "little") for i in range(1, size, 8)]]
        rest = rest[size:]
    if name in ("info", "execute_command"):
        wire.append(rest[1:])
        return wire if rest[0] == len(rest) - 1 else None
    return wire if not rest else None
