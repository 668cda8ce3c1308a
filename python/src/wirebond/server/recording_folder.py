"""A folder of recordings that are not being written: which there are, and what each is. Any thread; calls wait for the
disk."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from wirebond.errors import UsageError, WirebondError
from wirebond.link.attached.words import RecordingNote, StoredRecording
from wirebond.recording import capture
from wirebond.recording.glance import glance
from wirebond.recording.layout import ENDING

MOST_LISTED = 1000  # the newest ones
_ENDINGS = (ENDING, *capture.ENDINGS)


class RecordingFolder:
    """:param folder: it may be missing as long as nobody asks."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._known: dict[str, tuple[tuple[int, int], StoredRecording]] = {}  # by name: size and time of the file

    def newest(self) -> list[Path]:
        """Return the files, the newest first; at most 1000.

        :raises WirebondError: the folder cannot be read.
        """
        try:
            with os.scandir(self.folder) as entries:
                found = [(e.stat().st_mtime_ns, e.name) for e in entries if e.name.endswith(_ENDINGS) and e.is_file()]
        except OSError as error:
            raise WirebondError(f"cannot read the folder {self.folder}: {error.strerror or error}") from None
        return [self.folder / name for _, name in sorted(found, reverse=True)[:MOST_LISTED]]

    def list(self) -> list[StoredRecording]:
        """Return the recordings, the newest first.

        :raises WirebondError: the folder cannot be read.
        """
        return by_start(self.about(path) for path in self.newest())

    def path(self, name: str) -> Path:
        """Return the file of the recording with this name.

        :raises UsageError: there is none in the folder.
        """
        path = self.folder / name
        if Path(name).name != name or not name.endswith(_ENDINGS) or "\0" in name or not path.is_file():
            raise UsageError(
                f"there is no recording {name!r:.100} in {self.folder}; list the recordings to see their names"
            )
        return path

    def about(self, path: Path) -> StoredRecording | None:
        """Return the facts about this file, or None if it no longer exists."""
        try:
            stat = path.stat()
            key = stat.st_size, stat.st_mtime_ns
            known = self._known.get(path.name)
            found = known[1] if known is not None and known[0] == key else _seen(path)
        except OSError:
            self._known.pop(path.name, None)
            return None
        self._known[path.name] = key, found
        return found


def by_start(found: Iterable[StoredRecording | None]) -> list[StoredRecording]:
    """Return the existing recordings, the newest first."""
    return sorted((one for one in found if one is not None), key=lambda one: one.started, reverse=True)


def _seen(path: Path) -> StoredRecording:
    if capture.is_capture(path):
        stat = path.stat()
        return StoredRecording(path.name, str(path), "capture", started=stat.st_mtime, size=stat.st_size)
    try:
        found = glance(path)
    except WirebondError as error:
        return StoredRecording(path.name, str(path), "unreadable", size=path.stat().st_size, error=str(error))
    return StoredRecording(
        name=path.name,
        path=str(path),
        state="closed" if found.is_closed else "unclosed",
        started=found.started,
        seconds=found.seconds,
        size=found.size,
        protocol=found.protocol,
        hash=found.hash,
        notes=tuple(RecordingNote(note.written.timestamp(), note.text) for note in found.notes),
    )
