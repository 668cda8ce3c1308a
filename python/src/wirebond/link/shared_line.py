"""One line on which both ends send: decides who sent each frame. Takes bytes and times, gives messages; no port."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property

from wirebond.codec import Codec, Message
from wirebond.errors import MessageError
from wirebond.protocol.model import Address, End, HeaderField
from wirebond.protocol.planning import plan_for, told_by_request
from wirebond.protocol.sample_values import sample_values

_UNKNOWN = "unknown"


class Sender(StrEnum):
    """The sender of a received frame."""

    HOST = "host"
    MCU = "mcu"
    EITHER = "either"  # the protocol does not say


@dataclass(frozen=True)
class SharedStats:
    """The account of bytes of a shared line: ``bytes == frame_bytes + other_bytes + pending_bytes``.

    :ivar bytes: all of them.
    :ivar frames: how many frames each sender had: ``host``, ``mcu``, ``either``.
    :ivar frame_bytes: bytes in one of these.
    :ivar other_bytes: bytes in none: delimiters, rubbish.
    :ivar pending_bytes: bytes that may still become part of a frame.
    """

    bytes: int = 0
    frames: dict[str, int] = field(default_factory=dict)
    frame_bytes: int = 0
    other_bytes: int = 0
    pending_bytes: int = 0


class SharedLine:
    """Reads the line as the host's frames and as the MCU's. A frame that both readings find is the end's whose messages
    it fits; else the end's that its address names; else a reply, where the frame before asked for it, or a request.

    :param codec: the protocol.
    """

    def __init__(self, codec: Codec) -> None:
        self._codec = codec
        self._decoders = {end: codec.decoder(end) for end in (End.HOST, End.MCU)}
        self._replies = {m.name: m.reply for m in codec.model.messages if m.reply is not None}
        dependent = told_by_request(codec.model.messages, End.MCU)
        self._asking = {name for name, reply in self._replies.items() if reply in dependent}
        self._asked: str | None = None  # the reply that the last frame of the host asked for
        self._bytes = 0
        self._covered = 0  # no frame may begin before this byte
        self._frame_bytes = 0
        self._frames = dict.fromkeys((str(one) for one in Sender), 0)

    def feed(self, data: bytes, t: float) -> list[tuple[Sender, Message]]:
        """Take received bytes with their time; return the messages that they complete, in the order of the line."""
        begin = self._bytes
        self._bytes += len(data)
        of_host = self._decoders[End.HOST].feed(data, t)
        of_mcu = []
        at = 0
        for message in of_host:
            behind = message.offset + len(message.raw) - begin
            if message.name in self._asking and behind > at:
                of_mcu += self._decoders[End.MCU].feed(data[at:behind], t)
                self._decoders[End.MCU].expect(message.name)
                at = behind
        of_mcu += self._decoders[End.MCU].feed(data[at:], t)
        return self._told({End.HOST: of_host, End.MCU: of_mcu})

    def idle(self, t: float) -> list[tuple[Sender, Message]]:
        """Note that nothing came until then; return completed messages."""
        found = {end: decoder.idle(t) for end, decoder in self._decoders.items()}
        for message in found[End.HOST]:
            if message.name in self._asking:
                self._decoders[End.MCU].expect(message.name)
        return self._told(found)

    def finish(self) -> list[tuple[Sender, Message]]:
        """Note that nothing comes any more; return completed messages."""
        return self._told({end: decoder.finish() for end, decoder in self._decoders.items()})

    @property
    def stats(self) -> SharedStats:
        """Up to now."""
        pending = max(decoder.stats.pending_bytes for decoder in self._decoders.values())
        pending = min(pending, self._bytes - self._covered)
        other = self._bytes - self._frame_bytes - pending
        return SharedStats(self._bytes, dict(self._frames), self._frame_bytes, other, pending)

    @cached_property
    def untold(self) -> list[str]:
        """Return a sentence for each pair of messages that the protocol cannot distinguish."""
        sentences = []
        for message in self._codec.model.messages:
            if not message.sent_by(End.HOST):
                continue
            try:
                frame = self._codec.encode(message.name, sample_values(message, math.sin), sender=End.HOST)
            except MessageError:  # its fields have a rule together; nothing is known of it
                continue
            line = SharedLine(self._codec)
            readings = {end: [*decoder.feed(frame, 0.0), *decoder.finish()] for end, decoder in line._decoders.items()}
            for of_host in readings[End.HOST]:
                for of_mcu in readings[End.MCU]:
                    if (of_host.offset, of_host.raw) == (of_mcu.offset, of_mcu.raw) and line._sender(
                        of_host, of_mcu
                    ) == Sender.EITHER:
                        sentences.append(_sentence(of_host.name, of_mcu.name))
        return sentences

    # ---- whose a frame is

    def _told(self, found: dict[End, list[Message]]) -> list[tuple[Sender, Message]]:
        """Choose among overlapping frames the one that began first, or was complete first."""
        places: dict[tuple[int, int], dict[End, Message]] = {}
        for end, messages in found.items():
            for message in messages:
                places.setdefault((message.offset, len(message.raw)), {})[end] = message
        told = []
        for (offset, size), readings in sorted(places.items()):
            if offset < self._covered:
                continue
            self._covered = offset + size
            self._frame_bytes += size
            sender, message = self._settled(readings)
            self._frames[sender] += 1
            told.append((sender, message))
        return told

    def _settled(self, readings: dict[End, Message]) -> tuple[Sender, Message]:
        if len(readings) == 1:
            ((end, message),) = readings.items()
            sender = Sender(end)
        else:
            of_host, of_mcu = readings[End.HOST], readings[End.MCU]
            sender = self._sender(of_host, of_mcu)
            message = of_mcu if sender == Sender.MCU else of_host
        if sender != Sender.MCU:
            self._asked = self._replies.get(message.name, self._asked)
        elif message.name == self._asked:
            self._asked = None
        return sender, message

    def _sender(self, of_host: Message, of_mcu: Message) -> Sender:
        """Return the sender of a frame that is valid for both ends."""
        known = (of_host.name != _UNKNOWN, of_mcu.name != _UNKNOWN)
        if known[0] != known[1]:
            return Sender.HOST if known[0] else Sender.MCU
        told = self._by_address(of_host)
        if told is None and of_mcu.name == self._asked is not None:
            told = Sender.MCU
        if told is None and of_host.name in self._replies:
            told = Sender.HOST  # nothing was asked, so that this is not a reply
        return told or Sender.EITHER

    def _by_address(self, message: Message) -> Sender | None:
        for of_end, own in self._addresses.items():
            value = message.header.get(of_end.name)
            if value is None:
                continue
            is_hosts = of_end.value.wire_bits(value) == own
            return Sender.HOST if is_hosts == (of_end.address == Address.SENDER) else Sender.MCU
        return None

    @cached_property
    def _addresses(self) -> dict[HeaderField, int]:
        """The host's own address in the fields that name sender or receiver, where the ends' defaults differ."""
        found = {}
        for place in plan_for(self._codec.model, End.HOST).header:
            if place.address not in (Address.SENDER, Address.RECEIVER):
                continue
            own, other = (End.HOST, End.MCU) if place.address == Address.SENDER else (End.MCU, End.HOST)
            defaults = [place.value.wire_bits(place.default(end)) for end in (own, other)]
            if defaults[0] != defaults[1]:
                found[place] = defaults[0]
        return found


def _sentence(of_host: str, of_mcu: str) -> str:
    if of_host == of_mcu:
        return f"both ends send {of_host}, and its frames do not show which one sent them: they arrive as `either`"
    return (
        f"{of_host} of the host and {of_mcu} of the MCU look the same: such frames come as `either`, read as {of_host}"
    )
