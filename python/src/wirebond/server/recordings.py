"""Recordings that a server keeps in its own folder, for all its clients. Every call may wait for the disk, so none may
come from the thread of the server's loop, except ``current`` and ``mark``."""

from __future__ import annotations

import contextlib
import os
import queue
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from wirebond.errors import UsageError, WirebondError
from wirebond.link.attached.words import StoredRecording
from wirebond.recording.apart import begin_closing
from wirebond.recording.layout import ENDING
from wirebond.recording.notes import annotate
from wirebond.recording.recorder import Recorder
from wirebond.server.recording_folder import RecordingFolder, by_start
from wirebond.system import interrupt

if TYPE_CHECKING:
    from wirebond.link import Link

MOST_MARK = 1000  # characters


class Recordings:
    """One recording at a time. Any thread.

    :ivar folder: where they are; None: the server has no such folder.
    :param changed: called with a recording whose state changed.
    :raises UsageError: the folder cannot be made or written to.
    """

    def __init__(
        self, link: Link, folder: str | os.PathLike[str] | None, changed: Callable[[StoredRecording], None]
    ) -> None:
        self.folder = None if folder is None else _made(Path(folder))
        self._link = link
        self._changed = changed
        self._lock = threading.RLock()  # of the recorder
        self._recorder: Recorder | None = None
        self._files = None if self.folder is None else RecordingFolder(self.folder)
        self._errors: dict[str, str] = {}  # why those ended early that did
        self._closing: set[str] = set()
        self._to_close: queue.SimpleQueue[Path | None] = queue.SimpleQueue()
        self._closer: threading.Thread | None = None
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> StoredRecording:
        """Begin to record, in a new file that is named after the protocol and the time.

        :raises UsageError: one is being recorded; the server has no folder; the protocol was not read from a file.
        :raises WirebondError: the file cannot be written.
        """
        with self._lock:
            if self._recorder is not None and not self._recorder.error:
                raise UsageError(f"{self._recorder.path.name} is being recorded already; stop that first")
            self._end()
            path = _new_path(self._in_folder().folder, self._link.codec.name)
            try:
                self._recorder = Recorder(self._link, path)
            except OSError as error:
                raise WirebondError(f"cannot record to {path}: {error.strerror or error}; check the disk") from None
            found = self._current(self._recorder)
        self._changed(found)
        return found

    def stop(self) -> StoredRecording:
        """End the recording. The file is whole then, and is compressed by a process of its own.

        :raises UsageError: nothing is being recorded.
        """
        with self._lock:
            ended = self._end()
        if ended is None:
            raise UsageError("nothing is being recorded; start that first")
        return ended

    @property
    def current(self) -> StoredRecording | None:
        """The current recording, or None. Never waits."""
        recorder = self._recorder
        return None if recorder is None else self._current(recorder)

    def list(self) -> list[StoredRecording]:
        """Return the recordings of the folder, the newest first; at most 1000.

        :raises UsageError: the server has no folder.
        :raises WirebondError: the folder cannot be read.
        """
        return by_start(self._stored(path) for path in self._in_folder().newest())

    def path(self, name: str) -> Path:
        """Return the file of the recording with this name.

        :raises UsageError: there is none in the folder.
        """
        return self._in_folder().path(name)

    def mark(self, text: str, by: str = "") -> None:
        """Add an event ``mark`` with this text to every recording of the link, at this moment.

        :param by: the client that asks for it.
        :raises UsageError: the text is empty or too long.
        """
        if not text.strip() or len(text) > MOST_MARK:
            raise UsageError(f"the mark has {len(text)} characters; expected 1 to {MOST_MARK}, and not spaces alone")
        self._link.note("mark", text=text, **({"by": by} if by else {}))

    def annotate(self, name: str, text: str) -> StoredRecording:
        """Add a text to a recording that is closed.

        :raises UsageError: there is no such recording, or the text is empty or too long.
        :raises WirebondError: it is not closed, or cannot be written.
        """
        path = self.path(name)
        try:
            annotate(path, text)
        except OSError as error:
            raise WirebondError(f"cannot write to {path}: {error.strerror or error}; check the disk") from None
        found = self._stored(path)
        if found is None:
            raise UsageError(f"{name} was removed meanwhile")
        self._changed(found)
        return found

    # ---- for the server

    @property
    def has_failed(self) -> bool:
        """The recording ended early, as with a full disk, and nothing was done about it yet. Without waiting."""
        recorder = self._recorder
        return recorder is not None and bool(recorder.error)

    def end_failed(self) -> None:
        """End a recording whose file cannot be written any further."""
        with self._lock:
            if self.has_failed:
                self._end()

    def close(self) -> None:
        """End the recording that runs. Compression continues in its own process."""
        with self._lock:
            self._end()
            self._to_close.put(None)

    @property
    def is_closing(self) -> bool:
        """Files are being compressed."""
        return bool(self._closing)

    def wait(self) -> None:
        """Wait until every file is compressed. An interrupt leaves the files whole."""
        if self._closer is None:
            return
        try:
            while self._closer.is_alive():
                self._closer.join(0.1)  # so that a signal is seen
        except KeyboardInterrupt:
            process = self._process
            if process is not None:
                interrupt(process)
            raise

    # ---- inside

    def _in_folder(self) -> RecordingFolder:
        if self._files is None:
            raise UsageError(
                "this server has no folder for recordings; start it with `wirebond serve --recordings FOLDER`, or "
                "run `wirebond record` in a terminal"
            )
        return self._files

    def _end(self) -> StoredRecording | None:
        """End the recording; None: there was none."""
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return None
        recorder.close(compact=False)
        if recorder.error:
            self._errors[recorder.path.name] = recorder.error
        else:
            self._begin_closing(recorder.path)
        found = self._stored(recorder.path)
        if found is None:
            found = StoredRecording(recorder.path.name, str(recorder.path), "unreadable", error="it was removed")
        self._changed(found)
        return found

    def _begin_closing(self, path: Path) -> None:
        self._closing.add(path.name)
        self._to_close.put(path)
        if self._closer is None:
            self._closer = threading.Thread(target=self._close_files, name="closes recordings", daemon=True)
            self._closer.start()

    def _close_files(self) -> None:
        while (path := self._to_close.get()) is not None:
            with contextlib.suppress(OSError):  # it is whole, and larger
                self._process = begin_closing(path)
                self._process.wait()
            self._closing.discard(path.name)
            found = self._stored(path)
            if found is not None:
                self._changed(found)

    def _current(self, recorder: Recorder) -> StoredRecording:
        return StoredRecording(
            name=recorder.path.name,
            path=str(recorder.path),
            state="recording",
            started=recorder.started_ns / 1e9,
            seconds=recorder.seconds,
            size=recorder.size,
            protocol=self._link.codec.name,
            hash=f"{self._link.codec.hash:016x}",
            messages=recorder.messages,
            lost_bytes=recorder.lost_bytes,
            error=recorder.error,
        )

    def _stored(self, path: Path) -> StoredRecording | None:
        """Return the stored recording; None: it is gone."""
        recorder = self._recorder
        if recorder is not None and recorder.path == path:
            return self._current(recorder)
        found = self._in_folder().about(path)
        if found is None:
            return None
        if path.name in self._closing:
            return msgspec.structs.replace(found, state="closing")
        if found.state == "unclosed" and path.name in self._errors:
            return msgspec.structs.replace(found, error=self._errors[path.name])
        return found


def _made(folder: Path) -> Path:
    folder = folder.absolute()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"cannot make the folder {folder} for recordings: {error.strerror or error}; name another one"
        ) from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UsageError(f"the folder {folder} for recordings cannot be written to; name another one")
    return folder


def _new_path(folder: Path, protocol: str) -> Path:
    base = f"{protocol}-{time.strftime('%Y%m%d-%H%M%S')}"
    path, number = folder / f"{base}{ENDING}", 1
    while path.exists():
        number += 1
        path = folder / f"{base}-{number}{ENDING}"
    return path
