"""Writing a recording while it grows: pieces of a tap into an MCAP file without chunks, one write call for each batch.
No thread, no clock, no port."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wirebond import __version__
from wirebond.codec import Codec
from wirebond.errors import UsageError, WirebondError
from wirebond.link.tap import Chunk, LinkEvent
from wirebond.recording import layout
from wirebond.recording.locking import lock
from wirebond.recording.mcap_file import HEAD, McapWriter

_NEW_FILE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
# A pipe or a special file system has nothing that could be synced; a folder may be one that cannot be read.
_CANNOT_SYNC = (errno.EINVAL, errno.EROFS, errno.ENOSYS, errno.ENOTSUP, errno.EACCES, errno.EPERM)
LIBRARY = f"wirebond {__version__}"


class _Batch:
    """Collects bytes until they are written to the file at once."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def write(self, data: bytes) -> int:
        self._parts.append(data)
        self._size += len(data)
        return len(data)

    def tell(self) -> int:
        """Return the number of bytes since the beginning of the file."""
        return self._size

    def take(self) -> bytes:
        data = b"".join(self._parts)
        self._parts.clear()
        return data


class RecordingWriter:
    """A new file. One thread at a time, but for ``sync``. Times are seconds of the clock that the pieces have.

    :param path: of a file that does not exist yet.
    :param started: when the recording begins, on that clock.
    :param wall_ns: the same moment in nanoseconds since 1970. It is asked once; the pieces' own clock has no jumps.
    :param facts: texts that the recording keeps, such as its port.
    :raises UsageError: the protocol has no text; the file exists.
    :raises OSError: the file cannot be written.
    """

    def __init__(
        self, path: Path, codec: Codec, role: str, started: float, wall_ns: int, facts: Mapping[str, str]
    ) -> None:
        if not codec.model.text:
            raise UsageError("a recording keeps the protocol file, and this protocol was not read from one")
        self.path = path
        self.size = 0  # bytes of the file
        self.safe_size = 0  # bytes of them that the disk has
        self._last_us = self._flushed_us = self._safe_us = 0  # times of pieces, since the start
        self._origin_us = round(started * 1e6)
        self._wall_ns = wall_ns
        try:
            self._file = os.open(path, _NEW_FILE, 0o666)
        except FileExistsError:
            raise UsageError(f"{path} exists already; name another file, or remove it") from None
        lock(self._file)
        self._batch = _Batch()
        self._mcap = McapWriter(self._batch, layout.PROFILE, LIBRARY)
        about = {
            "version": layout.VERSION,
            "protocol": codec.name,
            "hash": f"{codec.hash:016x}",
            "role": role,
            "started_ns": str(wall_ns),
            "monotonic_us": str(self._origin_us),
            **facts,
        }
        self._mcap.add_metadata(layout.METADATA, about)
        text = codec.model.text.encode()
        self._mcap.add_attachment(wall_ns, layout.PROTOCOL_FILE, layout.MEDIA_TYPE, text)
        schema = self._mcap.add_schema("wirebond.Event", "jsonschema", layout.event_schema())
        self._channels = {
            "received": self._mcap.add_channel(layout.RECEIVED, layout.RAW, 0),
            "sent": self._mcap.add_channel(layout.SENT, layout.RAW, 0),
        }
        self._events = self._mcap.add_channel(layout.EVENTS, "json", schema)
        try:
            self.flush()
        except OSError:
            os.close(self._file)
            path.unlink(missing_ok=True)
            raise

    def add(self, piece: Chunk | LinkEvent) -> None:
        """Add a record. Nothing reaches the file before ``flush``."""
        at = self._ns(piece.t)
        self._last_us = round(piece.t * 1e6) - self._origin_us
        if isinstance(piece, Chunk):
            self._mcap.add_message(self._channels[piece.direction], at, piece.bytes, self._ns(piece.before))
            return
        t = round(piece.t - self._origin_us / 1e6, 6)
        self._mcap.add_message(self._events, at, layout.to_json({"t": t, "kind": piece.kind, **piece.facts}), at)

    def flush(self) -> None:
        """Write added records with one call. After an error the file ends with the last record that fits.

        :raises OSError: the system did not take all; the rest is gone.
        """
        data = memoryview(self._batch.take())
        written = 0
        try:
            while written < len(data):
                written += os.write(self._file, data[written:])
            self._flushed_us = self._last_us  # before the size, which `sync` reads first
            self.size += written
        except OSError as error:
            self.size += _whole_records(data[:written])
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self.size)
            error.filename = str(self.path)
            raise

    def sync(self) -> None:
        """Wait until the disk has what was flushed. Any thread, one at a time.

        :raises OSError: the disk does not have it. The system forgets such an error: later calls say nothing of it.
        """
        size, last_us = self.size, self._flushed_us
        if size == self.safe_size:
            return
        try:
            getattr(os, "fdatasync", os.fsync)(self._file)
            if self.safe_size == 0:
                _sync_folder(self.path.parent)  # in which the file is new
        except OSError as error:
            if error.errno not in _CANNOT_SYNC:
                raise
        self.safe_size, self._safe_us = size, last_us

    @property
    def unsafe(self) -> str:
        """A sentence: how much the disk has, and how much may be lost."""
        if self.safe_size == 0:
            return f"None of its {self.size} bytes are safe on the disk"
        return (
            f"Its first {self.safe_size} bytes, up to {self._safe_us / 1e6:.1f} s, are safe on the disk; the "
            f"{self.size - self.safe_size} bytes after them are not"
        )

    def finish(self) -> None:
        """Write the end of the file.

        :raises OSError: as ``flush``.
        """
        self._mcap.finish()
        self.flush()

    def close(self) -> None:
        """Give the file back, finished or not."""
        os.close(self._file)

    def _ns(self, t: float) -> int:
        return max(0, self._wall_ns + (round(t * 1e6) - self._origin_us) * 1000)


def _whole_records(data: memoryview) -> int:
    """Return the size of the complete records in it."""
    at = 0
    while len(data) - at >= HEAD.size:
        _, length = HEAD.unpack_from(data, at)
        if length > len(data) - at - HEAD.size:
            break
        at += HEAD.size + length
    return at


def _sync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0))
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def unsafe_sentence(error: OSError, path: Path, unsafe: str) -> str:
    """Write why a recording ended when the disk did not keep its bytes. ``unsafe``: of the writer."""
    return (
        f"the recording {path} ended early: the disk did not store the data ({error.strerror or error}); check the "
        f"disk, or record to another one. {unsafe}"
    )


def full_disk_sentence(error: OSError, path: Path) -> str:
    """Write why a recording ended early."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        why = "no space is left on the disk; make room, or record to another one"
    elif error.errno == errno.EFBIG:
        why = "the file may not become larger here; raise the limit, or record for a shorter time"
    else:
        why = f"{error.strerror or error}; check the disk"
    return f"the recording {path} ended early: {why}. Everything written before that can be read"


class RecordingEndedError(WirebondError):
    """The file of a recording could not be written any further."""


def facts_of(link: Any) -> dict[str, str]:
    """Return the facts about a link that a recording stores besides its bytes."""
    found = {}
    for name in ("port", "baud", "adapter_latency"):
        if (value := getattr(link, name, None)) is not None:
            found[name] = str(value)
    return found
