"""CRSF against crsf_parser."""

from __future__ import annotations

import contextlib
import io
from typing import Any

from crsf_parser import CRSFParser, PacketValidationStatus
from crsf_parser.handling import crsf_build_frame

from tests.contrib.oracle import Case, Oracle
from wirebond.protocol.model import End

_TYPES = {"battery": 0x08, "link_statistics": 0x14, "channels": 0x16}
_NAMES = {number: name for name, number in _TYPES.items()}
_FIELDS = {
    "battery": ("voltage", "current", "capacity", "remaining"),
    "link_statistics": (
        "uplink_rssi_ant_1",
        "uplink_rssi_ant_2",
        "uplink_link_quality",
        "uplink_snr",
        "diversity_active_antenna",
        "rf_mode",
        "uplink_tx_power",
        "downlink_rssi",
        "downlink_link_quality",
        "downlink_snr",
    ),
}


class Crsf(Oracle):
    def encode(self, case: Case) -> bytes | None:
        if case.message == "channels":  # the library lists them backwards
            return bytes(crsf_build_frame(_TYPES["channels"], {"channels": case.wire[0][::-1]}))
        flat = [n for value in case.wire for n in (value if isinstance(value, list) else [value])]
        payload = dict(zip(_FIELDS[case.message], flat, strict=True))
        return bytes(crsf_build_frame(_TYPES[case.message], payload))

    def decode(self, frame: bytes, sender: End) -> Case | None:
        found: list[tuple[Any, PacketValidationStatus]] = []
        rest = bytearray(frame)
        with contextlib.redirect_stdout(io.StringIO()):  # the library prints wrong checksums
            CRSFParser(lambda content, status: found.append((content, status))).parse_stream(rest)
        if len(found) != 1 or found[0][1] != PacketValidationStatus.VALID or rest:
            return None
        content = found[0][0]
        name = _NAMES.get(content.header.type)
        if name is None or content.header.frame_length != len(frame) - 2:
            return None
        if name == "channels":
            return Case(name, sender, [list(content.payload.channels)[::-1]])
        wire = [int(getattr(content.payload, field)) for field in _FIELDS[name]]
        return Case(name, sender, [wire[:2], *wire[2:]] if name == "link_statistics" else wire)
