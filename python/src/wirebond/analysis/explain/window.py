"""The part of many bytes that is worth an explanation: where they stop being frames."""

from __future__ import annotations

from wirebond.codec import Codec


def first_refused(codec: Codec, data: bytes, sender: str | None, most: int) -> int:
    """Return the start of a window of ``most`` bytes that contains the first refused ones: at the frame before them. 0
    if all bytes fit, or if none is refused. One pass of the decoder.

    :param sender: whose bytes they are; None: of either end.
    """
    if len(data) <= most:
        return 0
    decoder = codec.decoder(sender)
    frame_format = codec.model.format
    marks = {frame_format.opening, frame_format.delimiter, b""} - {None}
    at = before = 0
    for message in (*decoder.feed(data), *decoder.finish()):
        if data[at : message.offset] not in marks:
            return before
        before, at = message.offset, message.offset + len(message.raw)
    return before if at < len(data) else 0
