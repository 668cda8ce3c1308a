"""Recording a link while it runs: a thread drains the link's tap every 50 ms at the latest, another one waits for the
disk."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from wirebond.errors import WirebondError
from wirebond.link.tap import Chunk, LinkEvent, Taken, TapSource
from wirebond.recording.closing import close_recording
from wirebond.recording.writer import RecordingWriter, facts_of, full_disk_sentence, unsafe_sentence

BATCH = 0.05  # seconds between two writes at most
_SYNC = 1.0  # seconds between two waits for the disk
_logger = logging.getLogger("wirebond")

Progress = Callable[[int, int], object]


class Recorder:
    """Records from its creation to ``close``. The link continues whatever happens to the file.

    ``with link.record("run.mcap"):`` makes one. Any thread may read its counts.

    :param source: a link, or whoever has its tap.
    :param path: the new file.
    :ivar started_ns: when it began, in nanoseconds since 1970.
    :ivar bytes: recorded of both directions.
    :ivar chunks: reads and writes that were recorded.
    :ivar lost_bytes: of both directions; there was no room for them, because this thread came too late.
    :ivar error: why the file ended early, and what of it is not safe on the disk, in words; empty while it did not.
    :raises UsageError: the file exists, or the protocol was not read from a file.
    :raises OSError: the file cannot be written.
    """

    def __init__(self, source: TapSource, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.bytes = 0
        self.chunks = 0
        self.lost_bytes = 0
        self.error = ""
        self.started = time.monotonic()
        self.started_ns = time.time_ns()
        self._writer = RecordingWriter(
            self.path, source.codec, source.role, self.started, self.started_ns, facts_of(source)
        )
        self._tap = source.tap()
        self._source = source
        self._seconds: float | None = None
        self._stats: int | None = None
        self._frames_before = self._frames = 0
        self._is_gone = False
        self._has_disk_failed = False
        self._frames_before = self._messages_now()
        self._ends = threading.Event()
        self._is_closed = False
        self._lock = threading.Lock()  # of close
        self._thread = threading.Thread(target=self._record, name="wirebond-recorder", daemon=True)
        self._disk = threading.Thread(target=self._sync, name="wirebond-recorder-disk", daemon=True)
        self._thread.start()
        self._disk.start()

    @property
    def seconds(self) -> float:
        """The length of the recording so far."""
        return time.monotonic() - self.started if self._seconds is None else self._seconds

    @property
    def size(self) -> int:
        """Bytes of the file so far."""
        return self._writer.size

    @property
    def safe_size(self) -> int:
        """Bytes of the file that are safe on the disk: a power failure does not cost them."""
        return self._writer.safe_size

    @property
    def messages(self) -> int:
        """The number of frames that the source has received since then, if it has an account."""
        return self._messages_now() if self._stats is None else self._stats

    def _messages_now(self) -> int:
        with contextlib.suppress(WirebondError):  # the source has gone
            stats = getattr(self._source, "stats", None)
            self._frames = 0 if stats is None else int(stats.receive.frames) - self._frames_before
        return self._frames

    def close(self, *, compact: bool = True, progress: Progress | None = None) -> None:
        """Take what has come, finish the file. A second call does nothing.

        :param compact: also rewrite it: compressed, with the decoded messages. That takes some seconds for a million
            messages; the file is whole before, and stays so if this is interrupted or the disk is full.
        :param progress: called as ``progress(done, size)`` in that time.
        """
        with self._lock:
            if self._is_closed:
                return
            self._is_closed = True
            self._ends.set()
            self._thread.join()
            self._disk.join()
            with contextlib.suppress(WirebondError):  # the source has gone
                self._tap.close()
            if not self.error:
                self._try(self._writer.finish)
            if not self._has_disk_failed:
                self._wait_for_disk()
            self._writer.close()
            self._seconds = time.monotonic() - self.started
            self._stats = self._messages_now()
        if not compact or self.error:
            return
        try:
            self.compact(progress)
        except OSError as error:
            reason = error.strerror or error
            _logger.warning("the recording %s is whole, and was not compressed: %s", self.path, reason)

    def compact(self, progress: Progress | None = None) -> None:
        """Rewrite the closed file: compressed, with the decoded messages.

        :param progress: called as ``progress(done, size)`` in that time.
        :raises OSError: it cannot be written; the file is whole, as it was.
        """
        close_recording(self.path, progress=progress)

    def _record(self) -> None:
        due = time.monotonic()
        while True:
            due = max(due + BATCH * 0.8, time.monotonic())
            ending = self._ends.wait(max(0.0, due - time.monotonic()))
            taken = self._take()
            if self.error:
                if ending:
                    return
                continue
            for piece in taken.pieces:
                self._writer.add(piece)
                if isinstance(piece, Chunk):
                    self.bytes += len(piece.bytes)
                    self.chunks += 1
            if taken.lost_pieces:
                self.lost_bytes += taken.lost_received_bytes + taken.lost_sent_bytes
                facts = {
                    "pieces": taken.lost_pieces,
                    "received_bytes": taken.lost_received_bytes,
                    "sent_bytes": taken.lost_sent_bytes,
                }
                self._writer.add(LinkEvent(taken.pieces[-1].t if taken.pieces else self.started, "lost", facts))
            self._try(self._writer.flush)
            if ending:
                return

    def _take(self) -> Taken:
        """Take the new pieces. A link that is attached to a server has no tap while that is away; when it is back, a
        new one is opened."""
        event: list[LinkEvent] = []
        try:
            if self._is_gone:
                self._tap = self._source.tap()
                self._is_gone = False
                event = [LinkEvent(time.monotonic(), "source_back")]
            taken = self._tap.take()
            return Taken([*event, *taken.pieces], taken.lost_pieces, taken.lost_received_bytes, taken.lost_sent_bytes)
        except WirebondError as error:
            if not self._is_gone:
                event.append(LinkEvent(time.monotonic(), "source_gone", {"why": str(error)}))
            self._is_gone = True
            return Taken(event, 0, 0, 0)

    def _try(self, step: Callable[[], None]) -> None:
        try:
            step()
        except OSError as error:
            self.error = full_disk_sentence(error, self.path)
            _logger.error("%s", self.error)

    def _sync(self) -> None:
        while not self.error and not self._ends.wait(_SYNC):
            self._wait_for_disk()

    def _wait_for_disk(self) -> None:
        """Wait until the disk has the data. An error is reported at once, and only once by the system: that data is
        never safe any more."""
        try:
            self._writer.sync()
        except OSError as error:
            self._has_disk_failed = True
            if self.error:  # it ended because the disk was full, and has been reported
                self.error += f". {self._writer.unsafe}"
                return
            self.error = unsafe_sentence(error, self.path, self._writer.unsafe)
            _logger.error("%s", self.error)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
