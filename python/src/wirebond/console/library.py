"""The recordings of the server's folder, opened as sources of views. Any thread."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from wirebond.codec import Codec
from wirebond.console.station import Station
from wirebond.errors import UsageError
from wirebond.recording.capture import is_capture
from wirebond.recording.history.recorded import recorded_source
from wirebond.recording.history.source import Source
from wirebond.recording.recording import Recording
from wirebond.server.recording_folder import RecordingFolder

if TYPE_CHECKING:
    from wirebond.link.attached.words import StoredRecording
    from wirebond.server.recordings import Recordings

_MOST_OPEN = 3


class NoPortError(UsageError):
    """The request needs a port, and the console has none."""


@dataclass(frozen=True)
class Replay:
    """A recording that is looked at.

    :ivar started: seconds since 1970.
    """

    name: str
    source: Source
    problems: tuple[str, ...]
    duration: float
    started: float


class Library:
    """Keeps the last few open.

    :param folder: of the recordings, as long as no server has one.
    """

    def __init__(self, station: Station, folder: Path | None = None) -> None:
        self._station = station
        self._folder = None if folder is None else RecordingFolder(folder.absolute())
        self._lock = threading.Lock()
        self._open: OrderedDict[tuple[Path, int, int, int], Replay] = OrderedDict()

    def path(self, name: str) -> Path:
        """Return the file of a recording.

        :raises UsageError: there is none of this name.
        """
        return self._recordings().path(name)

    def codec_for(self, path: Path) -> Codec | None:
        """Return the codec for a file; None is the recording's own. A raw capture has none: the link's is used.

        :raises NoPortError: it is a raw capture, and there is no link.
        :raises OSError: it cannot be read.
        """
        if not is_capture(path):
            return None
        served = self._station.served
        if served is None:
            raise NoPortError(
                f"{path.name} is a raw capture, which has no protocol in it, and there is no link with one; connect to "
                "a port first, or to the capture"
            )
        return served.link.codec

    def list(self) -> tuple[Path | None, list[StoredRecording]]:
        """Return the folder, and its recordings, the newest first; None: there is no folder.

        :raises WirebondError: it cannot be read.
        """
        found = self._recordings()
        if found.folder is None:
            return None, []
        return found.folder, found.list() if found.folder.is_dir() else []

    def open(self, name: str) -> Replay:
        """Return a recording, read whole.

        :raises WirebondError: there is none, or it cannot be read.
        :raises OSError: the same.
        """
        path = self.path(name)
        stat, codec = path.stat(), self.codec_for(path)
        key = path, stat.st_size, stat.st_mtime_ns, 0 if codec is None else codec.hash
        with self._lock:
            found = self._open.get(key)
            if found is None:
                recording = Recording(path, codec)
                source = recorded_source(recording)
                found = Replay(name, source, tuple(recording.problems), recording.duration, recording.wall_ns(0) / 1e9)
                self._open[key] = found
                while len(self._open) > _MOST_OPEN:
                    self._open.popitem(last=False)
            self._open.move_to_end(key)
        return found

    def _recordings(self) -> Recordings | RecordingFolder:
        served = self._station.served
        if served is not None:
            return served.server.recordings
        if self._folder is None:
            raise NoPortError("the console has no port yet, and so no folder of recordings; connect it first")
        return self._folder
