"""Tries every format on one stream, and ranks them by their evidence. No file, port or clock."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import log2
from typing import Any

from wirebond.analysis.check.frame_facts import ENDS
from wirebond.analysis.identify.evidence import Background, Worth, background, cost_of_kinds, cost_of_places
from wirebond.analysis.identify.formats import Format, View
from wirebond.protocol.model import End
from wirebond.protocol.planning import plan_for

FITS = 20.0  # bits of evidence: bytes of chance give a format as much in 1 of a million streams
_OTHERS = "other messages"


@dataclass(frozen=True)
class Candidate:
    """The result of one format for the stream.

    :ivar evidence: bits by which it describes the stream shorter than chance does, less what the number of formats
        that were tried makes likely.
    :ivar frames: frames found, and ``known_frames`` of them of messages that the file lists.
    :ivar frame_bytes: bytes in them.
    :ivar distinct_frames: of the frames, those that differ. What is repeated says nothing new.
    :ivar chance_frames: frames of this kind that as many bytes of chance would hold, on average: what its constants,
        sizes, ids and checks let through. 0 where no frame was found.
    :ivar messages: how many frames of each message, the commonest first. What the file does not list stands under
        "other messages".
    :ivar senders: whose messages were seen.
    :ivar places: where each frame begins and ends.
    """

    format: Format
    evidence: float
    size: int
    frames: int
    known_frames: int
    distinct_frames: int
    frame_bytes: int
    chance_frames: float
    messages: dict[str, int]
    senders: tuple[End, ...]
    places: tuple[tuple[int, int], ...] = field(default=(), repr=False)

    @property
    def fits(self) -> bool:
        return self.evidence >= FITS

    @property
    def frame_share(self) -> float:
        """The part of the stream's bytes that are in its frames, 0 to 1."""
        return self.frame_bytes / self.size if self.size else 0.0

    def shared_with(self, other: Candidate) -> float:
        """Return the part of this one's bytes in frames that are in frames of the other, too."""
        others = bytearray(self.size)
        for begin, end in other.places:
            others[begin:end] = b"\1" * (end - begin)
        return sum(others[begin:end].count(1) for begin, end in self.places) / max(1, self.frame_bytes)

    @property
    def repeats(self) -> bool:
        """Is most of the stream in its frames, and do they say too little only because they repeat?"""
        return not self.fits and self.evidence > 0 and self.frame_share > 0.5 and self.frames > 2 * self.distinct_frames

    def as_dict(self) -> dict[str, Any]:
        """Return it as a dictionary for JSON."""
        return {
            "format": self.format.name,
            "file": self.format.model.path,
            "evidence_bits": round(self.evidence, 1),
            "frames": self.frames,
            "known_frames": self.known_frames,
            "distinct_frames": self.distinct_frames,
            "frame_bytes": self.frame_bytes,
            "frame_share": round(self.frame_share, 4),
            "chance_frames": self.chance_frames,
            "messages": self.messages,
            "senders": list(self.senders),
        }


@dataclass(frozen=True)
class _Sighting:
    offset: int
    raw: bytes
    name: str
    view: View
    bits: float

    @property
    def end(self) -> int:
        return self.offset + len(self.raw)


def rank(data: bytes, formats: Sequence[Format], tried: int = 1) -> list[Candidate]:
    """Rank every format on this stream, the best first. Takes some milliseconds for each format and 10 kB.

    :param tried: how many streams are looked at in this search, such as one for each baud rate.
    """
    over = background(data)
    charge = log2(max(1, len(formats) * tried))
    found = [one for each in formats if (one := _try(each, data, over, charge)) is not None]
    return sorted(found, key=lambda one: -one.evidence)


def _try(format: Format, data: bytes, over: Background, charge: float) -> Candidate | None:
    if not format.views or not data:
        return None
    model = format.read_as
    assert model is not None, "a format with views has a way to be read"
    worth = {end: Worth(model, plan_for(model, end), over, list(model.messages)) for end in ENDS}
    sightings: list[_Sighting] = []
    for view in format.views:
        decoder = view.codec.decoder(view.sender)
        for message in [*decoder.feed(data), *decoder.finish()]:
            knows = view.knows and message.name != "unknown"
            bits = worth[view.sender].of(message.raw, knows)
            name = message.name if knows else _OTHERS
            sightings.append(_Sighting(message.offset, message.raw, name, view, bits))
    chosen = _apart(sightings)
    known = sum(one.name != _OTHERS for one in chosen)
    size = sum(len(one.raw) for one in chosen)
    distinct = {one.raw: one.bits for one in chosen}
    told = cost_of_places(len(chosen), len(data) - size) + cost_of_kinds(known, len(chosen) - known)
    part = len(distinct) / len(chosen) if chosen else 1.0
    mean = sum(distinct.values()) / len(distinct) if distinct else 0.0
    return Candidate(
        format,
        sum(distinct.values()) - told * part - charge,
        len(data),
        len(chosen),
        known,
        len(distinct),
        size,
        len(data) * 2.0 ** -max(0.0, mean) if distinct else 0.0,
        dict(Counter(one.name for one in chosen).most_common()),
        tuple(end for end in ENDS if any(one.view.sender == end and one.name != _OTHERS for one in chosen)),
        tuple((one.offset, one.end) for one in chosen),
    )


def _apart(sightings: list[_Sighting]) -> list[_Sighting]:
    """Select frames that do not overlap: of two that do, the one that begins first; of the same bytes, the known
    message."""
    chosen: list[_Sighting] = []
    at = 0
    for one in sorted(sightings, key=lambda one: (one.offset, one.name == _OTHERS, -len(one.raw))):
        if one.offset >= at:
            chosen.append(one)
            at = one.end
    return chosen
