"""CRSF against crsf_parser."""

from __future__ import annotations

import contextlib
import io
import random
from typing import Any

from crsf_parser import CRSFParser, PacketValidationStatus
from crsf_parser.handling import crsf_build_frame

from tests.contrib.oracle import Case, Oracle
from wirebond.protocol.model import End, Message

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


_STARTS = {0xC8, 0xEE, 0xEA, 0xEC}  # for whom a frame is; no check covers it, and the library reads the first alone


class Crsf(Oracle):
    def header(self, message: Message, source: random.Random) -> dict[str, Any]:
        return {"magic": source.choice(sorted(_STARTS))}

    def encode(self, case: Case) -> bytes | None:
        if case.message == "channels":  # the library lists them backwards
            return _begun(case, crsf_build_frame(_TYPES["channels"], {"channels": case.wire[0][::-1]}))
        flat = [n for value in case.wire for n in (value if isinstance(value, list) else [value])]
        payload = dict(zip(_FIELDS[case.message], flat, strict=True))
        return _begun(case, crsf_build_frame(_TYPES[case.message], payload))

    def decode(self, frame: bytes, sender: End) -> Case | None:
        found: list[tuple[Any, PacketValidationStatus]] = []
        if frame[:1] == b"" or frame[0] not in _STARTS:
            return None
        header = {"magic": frame[0]}
        rest = bytearray(b"\xc8" + frame[1:])
        # The library prints wrong checksums, and raises KeyError where a damaged frame has the type of an attitude.
        with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(KeyError):
            CRSFParser(lambda content, status: found.append((content, status))).parse_stream(rest)
        if len(found) != 1 or found[0][1] != PacketValidationStatus.VALID or rest:
            return None
        content = found[0][0]
        name = _NAMES.get(content.header.type)
        if name is None or content.header.frame_length != len(frame) - 2:
            return None
        if name == "channels":
            return Case(name, sender, [list(content.payload.channels)[::-1]], header)
        wire = [int(getattr(content.payload, field)) for field in _FIELDS[name]]
        return Case(name, sender, [wire[:2], *wire[2:]] if name == "link_statistics" else wire, header)


def _begun(case: Case, frame: bytes) -> bytes:
    """The library's frame, for the device that the case names."""
    return bytes([case.header["magic"]]) + bytes(frame)[1:]
