"""Makes a frame of a program's message: its bytes, its address, and whether the link numbers it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

from wirebond.arguments import shown
from wirebond.codec import Codec
from wirebond.codec import Message as ReceivedMessage
from wirebond.errors import MessageError, QueueFullError, UsageError
from wirebond.link.ends import Receiver, other, own_address_field
from wirebond.link.engine import Engine
from wirebond.link.settings import MORE_ADDRESSES, reply_index, safe_value
from wirebond.protocol.model import Address, End, GivenMessage, Message
from wirebond.protocol.model.forms import header_fields
from wirebond.protocol.problems import no_message
from wirebond.protocol.spoken import SpokenVersion


@dataclass(frozen=True)
class OwnMessage:
    """A message that the link's end sends, with the numbers that the engine knows it by.

    :ivar reply: of the message that answers it; -1: none does.
    :ivar stop: its part in the emergency stop; None: it has none.
    """

    model: Message
    index: int
    reply: int
    stop: GivenMessage | None


# What an engine's ``send`` takes: index of the message, bytes, index of the reply, who gives the number, address.
Frame: TypeAlias = tuple[int, bytes, int, bool, int]


class FrameMaker:
    """Makes the frames of one link. Any thread."""

    def __init__(self, codec: Codec, end: End, engine: Engine) -> None:
        self._codec = codec
        self._end = end
        self._engine = engine
        self._format = codec.tables.format_for(end)
        self._receiver = Receiver(codec, end)
        header = header_fields(codec.model.format.parts)
        self._numbers = frozenset(field.name for field in header if field.is_sequence)
        self._address_field = own_address_field(codec, end)
        self._own_address: int | str | None = None  # the address that was set
        named = (Address.SENDER,) if end == End.HOST else (Address.SENDER, Address.MCU)
        self._sender = next((f.name for f in header if f.address in named), None)  # the field that says who sends
        stop = codec.model.emergency_stop if end == End.HOST else ()
        self._messages = {
            m.name: OwnMessage(m, i, reply_index(codec, m.name), next((s for s in stop if s.message == m.name), None))
            for i, m in enumerate(codec.model.messages)
            if m.sent_by(end)
        }
        self._has_safe: set[tuple[str, int]] = set()  # addresses of the stop's messages that have a safe value
        spoken = SpokenVersion(codec.model.format.parts) if end == End.MCU else None
        self._spoken = spoken if spoken is not None and spoken.is_one_of_several else None

    def message(self, name: str) -> OwnMessage:
        """Return a message that this end sends.

        :raises MessageError: the protocol has no such message, or it is the other end's.
        """
        found = self._messages.get(name) if isinstance(name, str) else None
        if found is not None:
            return found
        known = [m.name for m in self._codec.model.messages]
        if name not in known:
            raise MessageError(no_message(self._codec.name, name, known))
        raise MessageError(f"{name} is sent by the {other(self._end)}, not by the {self._end}")

    def make(self, message: OwnMessage, values: dict[str, Any], header: Mapping[str, Any] | None) -> Frame:
        """Make one frame that can leave.

        :raises MessageError: a value is wrong.
        :raises QueueFullError: see ``address_of``.
        """
        whole = self.with_own_address(header)
        data = self.encode(message, values, whole)
        return message.index, data, message.reply, self.takes_number(header), self.address_of(message, whole)

    def encode(self, message: OwnMessage, values: dict[str, Any], header: Mapping[str, Any] | None) -> bytes:
        """Return the frame's bytes.

        :raises MessageError: a value is wrong.
        """
        if self._spoken is None:
            return self._codec.tables.frame_of(message.index, self._format, values, header)
        return self._spoken.make(partial(self._codec.tables.frame_of, message.index, self._format, values), header)

    @property
    def follows_host(self) -> bool:
        """Does this end send in the version that the other end spoke last?"""
        return self._spoken is not None

    def hear(self, message: ReceivedMessage) -> None:
        """Note that the program gets this message now: its next frames are in the version of this one."""
        if self._spoken is not None:
            self._spoken.hear(message.header)

    def takes_number(self, header: Mapping[str, Any] | None) -> bool:
        """Return whether the link raises the frame's sequence number; not if the caller gave it."""
        return header is None or self._numbers.isdisjoint(header)

    def without_number(self, header: Mapping[str, Any]) -> dict[str, Any]:
        """Return these header values without a sequence number, which the link then raises."""
        return {name: value for name, value in header.items() if name not in self._numbers}

    # ---- addresses

    @property
    def has_addresses(self) -> bool:
        """Do frames say for whom they are, or is one of this end's own in them?"""
        return self._address_field is not None or self._codec.tables.address is not None

    @property
    def own_address(self) -> int | str | None:
        """Return the address of this end, or None."""
        if self._address_field is None:
            return None
        return self._address_field[1] if self._own_address is None else self._own_address

    def set_own_address(self, value: int | str) -> int:
        """Set the own address; return its bits on the wire.

        :raises UsageError: frames have none, or its field cannot hold this one, or it is a broadcast.
        """
        if self._address_field is None:
            raise UsageError(f"frames of {self._codec.name} have no address of the {self._end}")
        header_field = self._address_field[0]
        field = header_field.value
        known = dict(field.enum)
        if not (value in known if isinstance(value, str) else isinstance(value, int) and 0 <= value < 1 << field.width):
            limit = ", ".join(known) or f"0 to {(1 << field.width) - 1}"
            raise UsageError(f"address is {shown(value)}; {field.name} takes {limit}")
        if value in header_field.broadcast:
            raise UsageError(
                f"address is {shown(value)}, the broadcast of {field.name}; an end cannot have it as its own"
            )
        self._own_address = value
        return field.wire_bits(value)

    def with_own_address(self, header: Mapping[str, Any] | None) -> Mapping[str, Any] | None:
        """Add the own address, once it was set, if frames name their sender."""
        if self._own_address is None or self._sender is None:
            return header
        return {self._sender: self._own_address, **(header or {})}

    def bits_of(self, header: Mapping[str, Any]) -> int | None:
        """Return the bits of the address that these header values name; None: frames have none.

        :raises MessageError: a header value is wrong.
        """
        return self._receiver.bits_of(header)

    def address_of(self, message: OwnMessage, header: Mapping[str, Any] | None) -> int:
        """Return the bits of the address that the message goes to. One of the stop gets a safe value for it.

        :raises QueueFullError: the message has its safe values for too many other addresses.
        """
        address = self._receiver.bits_of(header or {})
        if address is None:
            return 0
        name, stop = message.model.name, message.stop
        if stop is None or (name, address) in self._has_safe or self._engine.is_stopped():  # then it will be refused
            return address
        if not self._engine.note_safe(safe_value(self._codec, stop, self.with_own_address(header) or {})):
            raise QueueFullError(f"{name} went to {MORE_ADDRESSES} addresses already, and each has its safe value")
        self._has_safe.add((name, address))
        return address
