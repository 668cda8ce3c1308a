"""Finds frames that contain a delimiter in bytes that are not stuffed, so that no receiver finds them."""

from __future__ import annotations

from wirebond.analysis.check.findings import Finding, Severity
from wirebond.analysis.check.frame_facts import senders
from wirebond.analysis.check.places import Places
from wirebond.analysis.check.wording import percent
from wirebond.analysis.samples import pool
from wirebond.codec import Codec

RULE = "cut-frame"
_FRAMES = 256  # of each message


def assess(codec: Codec, seed: int, places: Places) -> list[Finding]:
    """Decode frames with random values one by one, and report those that are cut short."""
    frame_format = codec.model.format
    is_stuffed = frame_format.stuffing.hides_delimiters and not any(part.is_plain for part in frame_format.parts)
    if frame_format.delimiter is None or is_stuffed:
        return []
    sent = lost = 0
    for end in senders(codec.model):
        frames = pool(codec, end, seed, _FRAMES)
        for frame in () if frames is None else frames.frames:
            sent += 1
            lost += codec.decode_columns(frame, end).stats.frame_bytes != len(frame)
    if not lost:
        return []
    place = places.part("delimiter")
    return [
        Finding(
            RULE,
            Severity.WARNING,
            f"{percent(lost / sent)} of frames with random values hold a delimiter, and no receiver finds them",
            "bytes between the delimiters are sent as they are, and one that is a delimiter cuts the frame",
            "stuff the parts, for example `cobs: [...]` between delimiters 0x00; or send values as text or hex digits",
            place.line,
            place.column,
        )
    ]
