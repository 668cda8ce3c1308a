"""A link without a protocol: it sends nothing, and only keeps the bytes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

from wirebond.codec import Codec
from wirebond.link import open_link
from wirebond.protocol.loader import loads
from wirebond.protocol.model import LinkSettings

NAME = "listener"
_LOOK = 0.05  # seconds between two checks for received bytes
# A link needs a protocol. What this one finds does not matter.
_TEXT = """
wirebond: 1
protocol: listener
frame: [magic: 0x55 0xAA 0x55 0xAA, payload: 1, check: crc-16/modbus]
messages: {heard: {sender: mcu, fields: {what: {type: u8}}}}
"""


def raw_codec(settings: LinkSettings) -> Codec:
    """Return a codec for a line with these settings."""
    return Codec(replace(loads(_TEXT), link=settings))


def listen_at(port: str, settings: LinkSettings, seconds: float) -> Iterator[bytes]:
    """Yield all the bytes so far, again and again, until the time is over. It sends nothing.

    :raises PortError: the port cannot be opened.
    """
    with open_link(raw_codec(settings), port, hold_back=False, listen="all", hello=False, clock_sync=False) as link:
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            link.receive(min(_LOOK, left))
            if link.stats.receive.bytes:
                yield link.dump().received


def is_raw(codec: Codec) -> bool:
    """Check whether it is one of `raw_codec`."""
    return codec.name == NAME and codec.model.text == _TEXT
