"""Messages that share a frame's id and are distinguished by `match`: candidates for a frame, and how it differs."""

from __future__ import annotations

from collections.abc import Sequence

from wirebond.protocol.matching import Told, one_id
from wirebond.protocol.model import End, MatchOf, Message, Protocol
from wirebond.protocol.spelling import match_texts

_MOST = 4  # messages that are listed


def sharing(protocol: Protocol, sender: End | None, number: int | None) -> list[Message]:
    """Return the messages of this sender with the id ``number`` (None: without an id), if `match` distinguishes
    them."""
    found = [
        message
        for message in protocol.messages
        if message.sent_by(sender)
        and message.has_id == (number is not None)
        and (number is None or (message.ids or one_id(message.id)).holds(number))
    ]
    return found if any(match_texts(message) for message in found) else []


def wanted_text(messages: Sequence[Message]) -> str:
    """List messages with their conditions: ``stop (command 1), run (command 2, 5..9)``."""
    texts = [f"{message.name} ({', '.join(match_texts(message)) or 'all'})" for message in messages]
    left = len(texts) - _MOST
    return ", ".join(texts if left <= 1 else [*texts[:_MOST], f"{left} more"])


def found_text(messages: Sequence[Message], told: Told) -> str:
    """Return the frame's values that these messages compare: ``command 4``."""
    texts: dict[str, str] = {}
    for match in (match for message in messages for match in message.match if match.of != MatchOf.ID):
        name = "payload size" if match.of == MatchOf.SIZE else match.name
        number = told.number_of(match)
        value = f"0x{number or 0:X}" if match.name == "magic" else str(number)
        texts.setdefault(name, f"no {name}" if number is None else f"{name} {value}")
    return ", ".join(texts.values())
