"""Jobs about bytes: what they mean, of which known format they are, and how they decode under another file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from wirebond.analysis.explain import explain
from wirebond.analysis.explain.data import explanation_dict
from wirebond.analysis.identify.formats import known_formats
from wirebond.analysis.identify.ranking import Candidate, rank
from wirebond.analysis.infer.unfitting import look_at_unfitting
from wirebond.codec import Codec
from wirebond.console.jobs.protocol_files import codec_of
from wirebond.protocol.model import End
from wirebond.recording.history.source import ENDS, Source
from wirebond.recording.history.told import message_dict
from wirebond.recording.recording import Reads, Recording

_ROWS = 50
_MOST_SHOWN = 8


def explained(text: str, name: str, data: bytes, sender: End | None) -> dict[str, Any]:
    """Return the meaning of the bytes under this file."""
    return explanation_dict(explain(codec_of(text, name).model, data, sender))


def identified(data: bytes) -> dict[str, Any]:
    """Return the known formats of these bytes, best first; if none fits, a description of the bytes."""
    known = known_formats()
    candidates = rank(data, known.formats)
    other = look_at_unfitting(data, known.formats, candidates)
    return candidates_dict(candidates, len(data), len(known.formats)) | other.as_dict()


def candidates_dict(candidates: Sequence[Candidate], size: int, tried: int) -> dict[str, Any]:
    """Return the fitting candidates as JSON objects.

    :param size: how many bytes were looked at.
    :param tried: how many formats.
    """
    fitting = [one for one in candidates if one.fits][:_MOST_SHOWN]
    matches = [
        {
            "name": one.format.name,
            "path": one.format.model.path,
            "share": one.frame_share,
            "frames": one.frames,
            "messages": one.messages,
            "evidence_bits": round(one.evidence, 1),
            "text": one.format.model.text,
        }
        for one in fitting
    ]
    return {"bytes": size, "formats_tried": tried, "matches": matches}


def decoded_recording(text: str, path: Path, capture_of: tuple[str, str] | None) -> dict[str, Any]:
    """Decode a recording under its own file and under this one.

    :param capture_of: text and name of the file that a raw capture is decoded with; None: it is not a capture.
    """
    edited, own = codec_of(text), Recording(path, None if capture_of is None else codec_of(*capture_of))
    again = Recording(path, edited)  # which reply is meant depends on the file
    before = _source(own.codec, End(own.role), own.idle, {end: own.reads(end) for end in ENDS})
    after = _source(edited, End(own.role), edited.model.idle_seconds, {end: again.reads(end) for end in ENDS})
    return _compared(before, after)


def decoded_reads(text: str, own: tuple[str, str], role: End, reads: dict[End, Reads]) -> dict[str, Any]:
    """Decode these bytes under the current file, ``own`` (text and name), and under this one."""
    edited, codec = codec_of(text), codec_of(*own)
    before = _source(codec, role, codec.model.idle_seconds, reads)
    return _compared(before, _source(edited, role, edited.model.idle_seconds, reads))


def _compared(before: Source, after: Source) -> dict[str, Any]:
    rows = [
        {"t": entry.t, "sender": end.value, "name": entry.name, "bytes": entry.bytes}
        | ({} if message is None else message_dict(message))
        for end, entry, message in after.entries(_ROWS, None, False)
    ]
    return {"before": _account(before), "after": _account(after), "rows": rows}


def _source(codec: Codec, role: End, idle: float, reads: dict[End, Reads]) -> Source:
    source = Source(codec, role, idle, most=None, keep=None)
    for end in ENDS:
        of = reads[end]
        source.feed_whole(end, of.data, of.ends, of.times, of.breaks, of.expected)
    return source


def _account(source: Source) -> dict[str, Any]:
    """Return the account of both ends together."""
    out: dict[str, Any] = {"bytes": 0, "frames": 0, "unknown_frames": 0, "discarded_bytes": {}, "messages": {}}
    for end in ENDS:
        stats = source.streams[end].stats()
        for key in ("bytes", "frames", "unknown_frames"):
            out[key] += stats[key]
        for key in ("discarded_bytes", "messages"):
            for name, count in stats[key].items():
                if count:
                    out[key][name] = out[key].get(name, 0) + count
    return out
