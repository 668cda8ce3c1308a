"""Facts that follow from the end that a link plays: its peer, its deadlines, its addresses. Values only."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from wirebond import _engine
from wirebond.codec import Codec
from wirebond.protocol.model import Address, End, HeaderField
from wirebond.protocol.model.forms import header_fields
from wirebond.protocol.planning import plan_for


def other(end: End) -> End:
    """Return the one across the line."""
    return End.MCU if end == End.HOST else End.HOST


def actions_at(codec: Codec, end: End) -> list[str]:
    """Return the actions of the deadlines at this end, in the engine's order."""
    return list(dict.fromkeys(d.then for d in codec.model.deadlines if d.at == end))


def own_address_field(codec: Codec, end: End = End.HOST) -> tuple[HeaderField, int | str] | None:
    """Return the field that holds this end's own address, and that address by default: what its peer sends as the
    receiver, else what it sends itself as the sender. A field with the MCU's address is the MCU's own."""
    fields = header_fields(codec.model.format.parts)
    receiver = next((f for f in fields if f.address == Address.RECEIVER), None)
    sender = next((f for f in fields if f.address == Address.SENDER), None)
    mcu = next((f for f in fields if f.address == Address.MCU), None) if end == End.MCU else None
    if mcu is not None:
        field, whose = mcu, End.MCU
    elif receiver is not None:
        field, whose = receiver, other(end)
    elif sender is not None:
        field, whose = sender, end
    else:
        return None
    default = field.default(whose)
    assert not isinstance(default, float), "an address is a whole number"
    return field, default


class Receiver:
    """The receiver of a frame of this end, by its header values."""

    def __init__(self, codec: Codec, end: End) -> None:
        self._format = codec.tables.format_for(end)
        self._place = plan_for(codec.model, end).address

    def bits_of(self, header: Mapping[str, Any]) -> int | None:
        """Return the address, as bits on the wire; None: frames have none.

        :raises MessageError: a header value is wrong.
        """
        return None if self._place is None else _engine.header_bits(self._format, dict(header))[self._place]
