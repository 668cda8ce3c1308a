"""Raw captures: bytes of a line that another program wrote, without times and without a protocol. Each is read as a
recording: its bytes come one after the other, as on a line that is full."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from wirebond.arguments import hex_bytes
from wirebond.codec import Codec
from wirebond.errors import UsageError
from wirebond.link.tap import Chunk
from wirebond.protocol.model import End
from wirebond.recording import layout
from wirebond.recording.mcap_file import MAGIC
from wirebond.recording.writer import RecordingWriter

ENDINGS = (".bin", ".hex")  # of files that a folder of recordings lists
_TEXT_ENDINGS = (".hex", ".txt")
_OTHERS = (layout.ENDING, ".yaml", ".yml")  # endings of files that are not captures, whatever they contain
_READ = 1 << 16  # bytes of the file at a time
_STEP = 0.001  # seconds of the line in a chunk
_MOST_CHUNKS = 1 << 20
_LOOKED_AT = 1 << 16  # bytes, to find out whose they are


def is_capture(path: Path) -> bool:
    """Return whether a file counts as a raw capture: it has bytes, and neither its name nor its content marks it as a
    recording or a protocol file.

    :raises OSError: it cannot be read.
    """
    if path.suffix in _OTHERS:
        return False
    with path.open("rb") as file:
        head, size = file.read(len(MAGIC)), file.seek(0, 2)
        file.seek(max(0, size - len(MAGIC)))
        return size > 0 and MAGIC not in (head, file.read())


def captured(path: Path) -> Iterator[bytes]:
    """Yield the bytes of a capture, some KiB at a time. A file that is called ``.hex`` or ``.txt`` has them as hex
    digits.

    :raises UsageError: the text is not hex digits.
    :raises OSError: it cannot be read.
    """
    if path.suffix not in _TEXT_ENDINGS:
        with path.open("rb") as file:
            while data := file.read(_READ):
                yield data
        return
    with path.open(encoding="ascii", errors="replace") as lines:
        for number, line in enumerate(lines, start=1):
            try:
                yield hex_bytes(line)
            except UsageError as error:
                raise UsageError(
                    f"{path}:{number}: {error}; bytes as they are belong in a file of another name"
                ) from None


@contextmanager
def as_recording(path: Path, codec: Codec) -> Iterator[Path]:
    """Yield a recording with the bytes of a capture, while the context lasts. It begins when the file was written last.

    :raises UsageError: it has no hex digits where it should.
    :raises OSError: it cannot be read, or there is no room for the recording.
    """
    step = _bytes_of_step(path, codec)
    direction = "sent" if _sender(path, codec) == End.HOST else "received"
    seconds = codec.model.link.bits_per_byte / codec.model.link.baud  # of a byte
    with tempfile.TemporaryDirectory(prefix="wirebond-") as folder:
        stored = Path(folder) / f"capture{layout.ENDING}"
        facts = {"port": str(path), layout.CAPTURE: f"{codec.model.link.baud}"}
        writer = RecordingWriter(stored, codec, End.HOST, 0.0, path.stat().st_mtime_ns, facts)
        try:
            at = 0
            for data in captured(path):
                for begin in range(0, len(data), step):
                    part = data[begin : begin + step]
                    writer.add(Chunk((at + len(part)) * seconds, at * seconds, direction, part))
                    at += len(part)
                writer.flush()
            writer.finish()
        finally:
            writer.close()
        yield stored


def _bytes_of_step(path: Path, codec: Codec) -> int:
    of_line = round(_STEP * codec.model.link.baud / codec.model.link.bits_per_byte)
    return max(1, of_line, path.stat().st_size // _MOST_CHUNKS)


def _sender(path: Path, codec: Codec) -> End:
    """Return the end that sent the first bytes."""
    data = bytearray()
    for part in captured(path):
        data += part
        if len(data) >= _LOOKED_AT:
            break
    return End.HOST if _messages(data, codec, End.HOST) > _messages(data, codec, End.MCU) else End.MCU


def _messages(data: bytes | bytearray, codec: Codec, sender: End) -> int:
    decoder = codec.decoder(sender)
    decoder.feed(bytes(data))
    decoder.finish()
    return sum(decoder.stats.messages.values())
