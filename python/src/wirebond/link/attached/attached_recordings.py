"""The recordings of the server that a link is attached to: started, ended, listed and annotated from here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import msgspec

from wirebond.link.attached import words
from wirebond.link.attached.words import StoredRecording

if TYPE_CHECKING:
    from wirebond.link.attached.attached_link import AttachedLink


class ServerRecordings:
    """Like ``Server.recordings``; the files are on the server's computer. Any thread. Each call raises ``UsageError``
    where the server refuses, with its reason, and ``LinkDownError`` where it is away."""

    def __init__(self, engine: AttachedLink) -> None:
        self._engine = engine

    def start(self) -> StoredRecording:
        """Let the server record, in a new file that is named after the protocol and the time."""
        return _one(self._engine.of_recordings(words.RecordStart()))

    def stop(self) -> StoredRecording:
        """End that recording, whoever began it. The server compresses the file then."""
        return _one(self._engine.of_recordings(words.RecordStop()))

    @property
    def current(self) -> StoredRecording | None:
        """Return the server's current recording, or None."""
        found = self._engine.of_recordings(words.Ask(what="recording"))
        return None if found is None else _one(found)

    def list(self) -> list[StoredRecording]:
        """Return the recordings in the server's folder, the newest first."""
        return [_one(found) for found in self._engine.of_recordings(words.ListRecordings())]

    def mark(self, text: str) -> None:
        """Add an event ``mark`` with this text to every recording of the link, at this moment."""
        self._engine.of_recordings(words.Mark(text=text))

    def annotate(self, name: str, text: str) -> StoredRecording:
        """Add a text to a recording that is closed."""
        return _one(self._engine.of_recordings(words.Annotate(recording=name, text=text)))


def _one(found: Any) -> StoredRecording:
    return msgspec.convert(found, StoredRecording)
