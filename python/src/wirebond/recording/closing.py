"""Closing a recording: chunks of 1 MiB, compressed, with the decoded messages, in the place of the file.

The new file is written beside the old one and takes its name at the end: whoever stops this finds the old one whole.
A recording has no index of its chunks. Readers in other languages find no message in a chunk whose messages are not
indexed one by one, and that takes 16 bytes for each, uncompressed: more than the messages of a rover take. Without it
they read the file from its beginning. An exported file has the whole index.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from mcap.writer import CompressionType, IndexType, Writer

from wirebond.errors import WirebondError
from wirebond.link.tap import Chunk, LinkEvent
from wirebond.protocol.model import End
from wirebond.recording import layout
from wirebond.recording.locking import lock
from wirebond.recording.recording import Recording
from wirebond.recording.whole import whole_file
from wirebond.recording.writer import LIBRARY

Progress = Callable[[int, int], object]
CHUNK = 1 << 20  # bytes before compression
_STEP = 4096  # pieces between two calls of `progress`


def close_recording(path: Path, *, progress: Progress | None = None) -> None:
    """Rewrite a finished or unfinished recording. The file's metadata say what was cut off or damaged.

    :raises WirebondError: it is no recording; it is being recorded.
    :raises OSError: it cannot be written; the file is as it was.
    """
    with path.open("rb") as file:
        if not lock(file.fileno()):
            raise WirebondError(f"{path} is being recorded at the moment; end that first")
        write_mcap(Recording(path), path, progress=progress)


def write_mcap(
    recording: Recording, out: Path, *, raw: bool = True, message: str | None = None, progress: Progress | None = None
) -> None:
    """A whole MCAP file of a recording at ``out``, or nothing.

    :param raw: with the raw bytes, events and the protocol file; False: decoded messages alone.
    :param message: only this one, of decoded messages; None: all.
    """
    with whole_file(out) as file:
        _Rewriting(recording, file, raw, message).run(progress)


class _Rewriting:
    def __init__(self, recording: Recording, file: IO[bytes], raw: bool, message: str | None) -> None:
        self._recording = recording
        self._message = message
        self._raw = raw
        self._topics: dict[str, int] = {}
        self._writer = writer = Writer(
            file,
            chunk_size=CHUNK,
            compression=CompressionType.ZSTD,
            index_types=IndexType.ATTACHMENT | IndexType.METADATA if raw else IndexType.ALL,
        )
        writer.start(layout.PROFILE, LIBRARY)
        about = dict(recording._about) or {"version": layout.VERSION}
        if recording.problems:
            about["repaired"] = "; ".join(recording.problems)[:4096]
        writer.add_metadata(layout.METADATA, about)
        if recording.protocol_text:
            text = recording.protocol_text.encode()
            at = recording._start_ns
            writer.add_attachment(at, at, layout.PROTOCOL_FILE, layout.MEDIA_TYPE, text)
        if raw:
            schema = writer.register_schema("wirebond.Event", "jsonschema", layout.event_schema())
            self._channels = {
                "received": writer.register_channel(layout.RECEIVED, layout.RAW, 0),
                "sent": writer.register_channel(layout.SENT, layout.RAW, 0),
            }
            self._events = writer.register_channel(layout.EVENTS, "json", schema)
            for note in recording._notes:
                writer.add_metadata(layout.NOTE, note)

    def run(self, progress: Progress | None) -> None:
        recording = self._recording
        start, add, total = recording._start_ns, self._writer.add_message, len(recording._kinds)
        done = 0
        for piece, end, message in recording.walk():
            at = start + round(piece.t * 1e6) * 1000
            if message is None:
                if self._raw:
                    self._add_raw(piece, at)
                done += 1
                if progress is not None and done % _STEP == 0:
                    progress(done, total)
            elif self._message in (None, message.name):
                t = start + round(message.t * 1e6) * 1000
                add(self._topic(message, end), at, layout.message_json(message), t)
        self._writer.finish()  # type: ignore[no-untyped-call]
        if progress is not None:
            progress(total, total)

    def _add_raw(self, piece: Chunk | LinkEvent, at: int) -> None:
        if isinstance(piece, Chunk):
            before = self._recording._start_ns + round(piece.before * 1e6) * 1000
            self._writer.add_message(self._channels[piece.direction], at, piece.bytes, before)
        else:
            values = {"t": round(piece.t, 6), "kind": piece.kind, **piece.facts}
            self._writer.add_message(self._events, at, layout.to_json(values), at)

    def _topic(self, message: Any, end: str) -> int:
        topic = layout.topic_of(message, End(end))
        if topic not in self._topics:
            codec = self._recording.codec
            schema = self._writer.register_schema(topic, "jsonschema", layout.message_schema(codec, message.name))
            self._topics[topic] = self._writer.register_channel(topic, "json", schema)
        return self._topics[topic]
