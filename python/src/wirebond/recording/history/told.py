"""A message for other programs: names and plain values."""

from __future__ import annotations

from typing import Any

from wirebond.as_json import plain
from wirebond.codec import Message


def message_dict(message: Message) -> dict[str, Any]:
    """Return its values; header and violations if it has some."""
    found: dict[str, Any] = {"fields": plain(message.fields)}
    if message.header:
        found["header"] = plain(message.header)
    if message.violations:
        found["violations"] = message.violations
    if message.name == "unknown":
        found["id"] = message.id
    return found
