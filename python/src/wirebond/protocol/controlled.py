"""Finds the messages of the host that cause motion, so that only one program at a time may send them."""

from __future__ import annotations

from wirebond.protocol.model import End, Message, Protocol


def is_controlled(protocol: Protocol, message: Message) -> bool:
    """Return whether this message of the host moves something. If so, only the client in control may send it: it has an
    ``every``, a deadline at the MCU, or is in the emergency stop. A request with an ``every`` and neither of the other
    two only asks: programs share it."""
    return message.sent_by(End.HOST) and (
        (message.every is not None and message.reply is None)
        or any(d.message == message.name and d.at == End.MCU for d in protocol.deadlines)
        or any(stop.message == message.name for stop in protocol.emergency_stop)
    )
