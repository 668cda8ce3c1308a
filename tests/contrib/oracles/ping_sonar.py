"""Blue Robotics' Ping against their own bluerobotics-ping."""

from __future__ import annotations

import random

from brping import PingMessage, PingParser, definitions

from tests.contrib.oracle import Case, Oracle
from wirebond.protocol.model import End, Message

_MESSAGES = {
    "ack": 1, "nack": 2, "protocol_version": 5, "general_request": 6, "set_ping_interval": 1004, "general_info": 1210,
    "distance": 1212,
}  # fmt: skip
_REQUESTS = {"request_general_info": 1210, "request_distance": 1212}  # an empty frame with the id of the answer
_NAMES = {number: name for name, number in _MESSAGES.items()}
_KNOWN = {number: definitions.payload_dict_all[number] for number in _NAMES}


class PingSonar(Oracle):
    def header(self, message: Message, source: random.Random) -> dict[str, int]:
        return {"source": source.randrange(256), "destination": source.randrange(256)}

    def encode(self, case: Case) -> bytes | None:
        if case.message == "nack":
            return None  # the library reads its text and cannot write it
        if case.message in _REQUESTS:
            message = PingMessage()
            message.request_id = _REQUESTS[case.message]
        else:
            message = PingMessage(_MESSAGES[case.message])
        message.src_device_id, message.dst_device_id = case.header["source"], case.header["destination"]
        for name, value in zip(message.payload_field_names if case.wire else (), case.wire, strict=True):
            setattr(message, name, value)
        return bytes(message.pack_msg_data())

    def decode(self, frame: bytes, sender: End) -> Case | None:
        parser = PingParser(_KNOWN)
        found = None
        for index, byte in enumerate(frame):
            if parser.parse_byte(byte) == PingParser.NEW_MESSAGE and index == len(frame) - 1:
                found = parser.rx_msg
        if found is None or bytes(found.msg_data) != frame or found.message_id not in _NAMES:
            return None
        if sender == End.HOST and found.message_id in _REQUESTS.values():
            name = next(name for name, number in _REQUESTS.items() if number == found.message_id)
            return Case(name, sender, [], _addresses(found)) if not found.payload_length else None
        wire = [getattr(found, name, b"") for name in found.payload_field_names]  # an empty text is left out
        return Case(_NAMES[found.message_id], sender, wire, _addresses(found))


def _addresses(found: PingMessage) -> dict[str, int]:
    return {"source": found.src_device_id, "destination": found.dst_device_id}
