"""A protocol as the engine knows it: its tables, and the numbers of messages and addresses. Internal."""

from __future__ import annotations

from collections.abc import Mapping
from sys import intern
from typing import Any

from wirebond import _engine
from wirebond.arguments import shown
from wirebond.errors import MessageError, UsageError
from wirebond.protocol.apart import ends_look_alike
from wirebond.protocol.model import End, HeaderField, Protocol
from wirebond.protocol.planning import ids_collide, plan_for
from wirebond.protocol.problems import no_message
from wirebond.protocol.tables import format_table, protocol_table

_NO_HEADER: dict[str, Any] = {}


class EngineTables:
    """Does not change, apart from tables that are made when first used. Any thread.

    :ivar protocol: the engine's table of messages and fields.
    :ivar indices: the index of each message, by name.
    :ivar address: the place of the header field with the address that a frame of the host is for; None: there is none.
    :ivar broadcasts: the addresses, as bits on the wire, that mean all devices.
    """

    def __init__(self, model: Protocol) -> None:
        self._model = model
        self._formats: dict[End | None, _engine.FormatTable] = {}
        plan = plan_for(model, End.HOST)
        self.protocol = _engine.ProtocolTable(protocol_table(model))
        self.indices = {intern(message.name): i for i, message in enumerate(model.messages)}
        self.address = plan.address
        self.broadcasts = plan.broadcast

    def format_for(self, sender: End | None) -> _engine.FormatTable:
        """Return the engine's table for frames of this sender; None: of either."""
        if sender not in self._formats:
            self._formats[sender] = _engine.FormatTable(format_table(plan_for(self._model, sender)))
        return self._formats[sender]

    def frame_of(
        self, index: int, form: _engine.FormatTable, values: dict[str, Any], header: Mapping[str, Any] | None
    ) -> bytes:
        """Encode one frame of the message with this index, in a format of `format_for`.

        :raises MessageError: a value is refused.
        """
        given = _NO_HEADER if header is None else dict(as_mapping("header", header))
        return _engine.encode(self.protocol, form, index, values, given)

    def sequence_of(self, sender: End) -> HeaderField | None:
        """Return the sequence number in frames that this end sends without header values; None: there is none."""
        plan = plan_for(self._model, sender)
        if plan.sequence is None or all(field.place != plan.sequence for field in plan.forms[0].header):
            return None
        return plan.header[plan.sequence]

    def address_of(self, header: Mapping[str, Any]) -> int | None:
        """Return the address of a frame of the host with these header values, as bits; None: frames have none.

        :raises MessageError: a wrong name or value.
        """
        if self.address is None:
            return None
        return _engine.header_bits(self.format_for(End.HOST), dict(header))[self.address]

    def reply_to(self, request: str) -> str:
        """Return the message that answers ``request``.

        :raises UsageError: the protocol has no such message, or it has no ``reply``.
        """
        index = self.indices.get(request) if isinstance(request, str) else None
        if index is None:
            raise UsageError(no_message(self._model.name, request, self.indices))
        reply = self._model.messages[index].reply
        if reply is None:
            asking = ", ".join(m.name for m in self._model.messages if m.reply is not None) or "none"
            raise UsageError(f"{request} has no `reply` in {self._model.name}; messages that have one: {asking}")
        return reply

    def request_for(self, reply: str) -> str | None:
        """Return the first message that ``reply`` answers."""
        return next((m.name for m in self._model.messages if m.reply == reply), None)

    def sender_for(self, sender: str | None) -> End | None:
        """Check a sender that a user named.

        :raises UsageError: no such end, or None if frames of the two ends cannot be distinguished.
        """
        model = self._model
        if sender is None:
            collisions = ids_collide(model)
            if collisions:
                first, second = collisions[0]
                raise UsageError(
                    f"in {model.name} the id 0x{first.id:02X} means {first.name} from {first.sender} and "
                    f"{second.name} from {second.sender}; say whose bytes these are: `--sender mcu`, or in Python "
                    "sender='mcu'"
                )
            if ends_look_alike(model.format.parts):
                raise UsageError(
                    f"in {model.name} frames of the two ends differ, and the same bytes can be a frame of either; "
                    "say whose bytes these are: sender='mcu' or sender='host'"
                )
            return None
        if sender not in (End.HOST, End.MCU):
            raise UsageError(f"sender is {shown(sender)}; expected 'mcu' or 'host'")
        return End(sender)


def as_mapping(owner: str, values: Mapping[str, Any]) -> Mapping[str, Any]:
    """Check that ``values`` is a mapping.

    :raises MessageError: it is not.
    """
    if type(values) is not dict and not isinstance(values, Mapping):  # the first is ten times as quick
        what = "the frame's own fields" if owner == "header" else "its fields"
        raise MessageError(f"{owner} is {shown(values)}; expected {what} as a mapping of names and values")
    return values
