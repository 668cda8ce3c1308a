"""A recording as a source of views: read once, and kept whole."""

from __future__ import annotations

from wirebond.protocol.model import End
from wirebond.recording.history.source import ENDS, Source
from wirebond.recording.recording import Recording


def recorded_source(recording: Recording) -> Source:
    """Return the recording's history, its bytes and its events. Times are seconds since its start."""
    source = Source(recording.codec, End(recording.role), recording.idle, most=None, keep=None)
    for end in ENDS:
        reads = recording.reads(end)
        source.feed_whole(end, reads.data, reads.ends, reads.times, reads.breaks, reads.expected)
    for event in recording.events:
        source.happened(event)
    source.look(recording.duration)
    return source
