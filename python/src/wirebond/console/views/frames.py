"""The newest frames, and the bytes that are in none."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec

from wirebond.codec import Message
from wirebond.console.views.view import Scene, SourceView
from wirebond.link.raw import is_raw
from wirebond.protocol.model import End
from wirebond.recording.history.source import Source
from wirebond.recording.history.stream import Entry
from wirebond.recording.history.told import message_dict

MOST_FRAMES = 500
FRAMES_EVERY = 0.1  # seconds


class Frames(msgspec.Struct):
    """The newest frames; ``message`` None: of all messages."""

    message: str | None = None
    discards: bool = True
    most: Annotated[int, msgspec.Meta(ge=1, le=MOST_FRAMES)] = 50


class FramesView(SourceView[Frames]):
    wish = Frames
    _sent: object = None  # shows whether anything has changed

    def moved(self) -> None:
        super().moved()
        self._sent = None

    def look(self, source: Source, scene: Scene) -> dict[str, Any] | None:
        if not self._is_due(scene.now, FRAMES_EVERY):
            return None
        wanted = self.wanted
        found = source.entries(wanted.most, wanted.message, wanted.discards, scene.at)
        entries = [_entry(source, end, entry, decoded) for end, entry, decoded in found]
        marks = [(e["n"], e["direction"], e["size"]) for e in entries]
        if self._sent == marks:
            return None
        self._sent = marks
        return {"t": scene.shown, "entries": entries}


def _entry(source: Source, end: End, entry: Entry, message: Message | None) -> dict[str, Any]:
    out: dict[str, Any] = {
        "n": entry.offset,
        "t": entry.t,
        "direction": "sent" if end == source.role else "received",
        "bytes": entry.bytes.hex(),
        "size": entry.size,
    }
    if entry.name:
        out |= {"kind": "frame", "message": entry.name}
        return out if message is None else out | message_dict(message)
    if is_raw(source.codec):
        return out | {"kind": "bytes"}
    return out | {"kind": "fill" if source.streams[end].is_fill(entry) else "discarded"}
