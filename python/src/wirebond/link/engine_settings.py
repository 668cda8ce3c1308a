"""The settings that a link gives to the engine when it opens, as `link_setup` in engine/src/link_setup.cpp reads
them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, NamedTuple

import msgspec

if TYPE_CHECKING:
    from wirebond._engine import FormatTable
    from wirebond.protocol.model import Parity


class SafeValue(NamedTuple):
    """A message of the emergency stop. Messages are indices in the protocol."""

    message: int
    frame: bytes
    reply: int  # -1: it has none
    every: float  # seconds between two while a stop holds
    address: int  # as bits on the wire; 0 where frames have none
    is_in_stop: bool  # False: it only ends a lease, because the stop's broadcast reaches this address too


class EngineDeadline(NamedTuple):
    """A deadline at the link's end."""

    message: int
    after_us: int
    action: int  # its place in `actions_at`
    is_explicit: bool  # only `recover` ends it
    is_held: bool  # and it has struck from the start


class EnginePeerStop(NamedTuple):
    """How a link at an MCU recognises one message of the emergency stop."""

    message: int
    payload: bytes
    mask: bytes  # of the payload's bits that count
    is_whole: bool  # a payload of another size is not it


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineAddressing:
    """The rules for foreign frames: `HostAddressing::Rules`."""

    receiver_place: int  # of the header field that says for whom a frame is; -1: none
    sender_place: int  # of the one that says who answers; -1: none
    own: int  # the link's address, as bits on the wire
    only_last_asked: bool  # one request is under way at a time
    broadcast: tuple[int, ...]
    more_addresses: int  # that have leases and safe values, beside the first of each message


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineSettings:
    """Seconds are 0 where there is no such time."""

    # The port
    baud: int
    data_bits: int
    parity: Parity
    stop_bits: int
    # Sending
    paced: bool
    bits_per_byte: int  # start and stop included
    send: FormatTable
    send_pause_seconds: float  # between two frames, where silence ends one
    max_age_seconds: float  # that a frame waits
    echo: bool  # the line echoes sent bytes
    largest_frame: int  # bytes on the wire
    every: tuple[float, ...]  # of each message of the protocol: the seconds between two
    latest: tuple[bool, ...]  # of each message: only the newest frame waits
    stop: tuple[SafeValue, ...]
    # Receiving
    idle_seconds: float  # of silence, after which an incomplete frame is given up
    pause_seconds: float  # of silence that ends a frame
    addressing: EngineAddressing
    deadlines: tuple[EngineDeadline, ...]
    peer_stops: tuple[EnginePeerStop, ...]  # the messages of the stop that the peer sends
    hold_back: bool
    recent_bytes: int  # of both directions that are kept for a dump

    def table(self) -> bytes:
        """Return all settings but ``send``, by name, in bytes (MessagePack)."""
        members = (member.name for member in fields(self) if member.name != "send")
        return msgspec.msgpack.encode({name: getattr(self, name) for name in members})
