"""S.BUS against crsf_parser, whose CRSF took over the channels of S.BUS bit for bit; the bytes around them by hand."""

from __future__ import annotations

from construct import StreamError
from crsf_parser.payloads import payload_rc_channels_packed

from tests.contrib.oracle import Case, Oracle
from wirebond.protocol.model import End

_CHANNELS = slice(1, 23)


class Sbus(Oracle):
    def encode(self, case: Case) -> bytes | None:
        channels, state = case.wire
        packed = payload_rc_channels_packed.build({"channels": channels[::-1]})  # the library lists them backwards
        return b"\x0f" + packed + bytes([state, 0])

    def decode(self, frame: bytes, sender: End) -> Case | None:
        if len(frame) != 25 or frame[0] != 0x0F or frame[24] != 0 or frame[23] > 0x0F:
            return None
        try:
            channels = payload_rc_channels_packed.parse(frame[_CHANNELS]).channels
        except StreamError:
            return None
        return Case("channels", sender, [list(channels)[::-1], frame[23]])
