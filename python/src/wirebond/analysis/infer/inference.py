"""The search for a format: every promising cut with its check is a protocol file; the one with most evidence wins."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from wirebond.analysis.identify.formats import format_of
from wirebond.analysis.identify.ranking import Candidate, rank
from wirebond.analysis.infer.checks import best_check
from wirebond.analysis.infer.cuts import Cut, Length, Sizes, cuts_of
from wirebond.analysis.infer.draft import Draft, draft
from wirebond.errors import ProtocolFileError
from wirebond.protocol import loads
from wirebond.protocol.model import End, Protocol

MOST_BYTES = 1 << 15  # that are examined: some hundred frames show as much as more
_ALIKE = 0.6  # part of the most evidence


@dataclass(frozen=True)
class Inference:
    """A first protocol file for bytes of an unknown format.

    :ivar model: the protocol that ``text`` describes.
    :ivar text: the file, with the evidence for each line as a comment.
    :ivar candidate: what it finds in the bytes.
    :ivar draft: the cut and the check it is based on, and its uncertainties.
    """

    model: Protocol
    text: str
    candidate: Candidate
    draft: Draft

    @property
    def frame_lines(self) -> list[str]:
        """The section of the file that says what a frame is."""
        lines = self.text.splitlines()
        begin = lines.index("frame:")
        return list(itertools.takewhile(lambda line: line == "frame:" or line.startswith(" "), lines[begin:]))


def infer(data: bytes, name: str = "inferred", source: str = "a capture", sender: End = End.MCU) -> Inference | None:
    """Return the most likely format of bytes that no known format explains. None where nothing in them repeats as
    frames do.

    It takes some seconds; pure, any thread.

    :param data: of one sender, best some hundred frames whose values change; the first 32 KiB are looked at.
    :param name: of the protocol in the file.
    :param source: where the bytes are from, as the file's first comment says it.
    :param sender: whose bytes they are.
    """
    data = data[:MOST_BYTES]
    cuts = cuts_of(data)
    drafts = [d for cut in cuts if not isinstance(cut.rule, Sizes) for d in _drafts(cut, name, source, sender)]
    if not any(one.check is not None for one in drafts):
        drafts += [d for cut in cuts if isinstance(cut.rule, Sizes) for d in _drafts(cut, name, source, sender)]
    known: dict[str, tuple[Protocol, Draft]] = {}
    for number, one in enumerate(drafts):
        try:
            model = loads(one.text, f"draft {number}")
        except ProtocolFileError:
            continue  # a cut that no file can describe
        known[model.path] = model, one
    candidates = [one for one in rank(data, [format_of(model) for model, _ in known.values()]) if one.fits]
    if not candidates:
        return None
    checked = [one for one in candidates if known[one.format.model.path][1].check is not None] or candidates
    best = max(_alike(checked), key=lambda one: _natural(known[one.format.model.path][1].cut, data))
    model, chosen = known[best.format.model.path]
    return Inference(model, chosen.text, best, chosen)


def _alike(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return candidates with about as much evidence as the first, such as frames that are cut at another place, each
    with a bit of the next one at its end."""
    return [one for one in candidates if one.evidence > _ALIKE * candidates[0].evidence]


def _natural(cut: Cut, data: bytes) -> tuple[bool, bool, int, int]:
    """Rank two readings of the same frames by what a designer would have chosen: one size or a length rather than a
    table of sizes, delimiters rather than constants. Constants between two frames may end one or begin the next: the
    capture most likely begins and ends with whole frames; otherwise constants begin a frame."""
    edges = data.startswith(cut.frames[0]) + data.endswith(cut.frames[-1]) if cut.by_start else 0
    return not isinstance(cut.rule, Sizes), not cut.by_start, edges, -len(cut.tail)


def _drafts(cut: Cut, name: str, source: str, sender: End) -> list[Draft]:
    numbers = [range(cut.rule.at + 1, cut.rule.at + cut.rule.size)] if isinstance(cut.rule, Length) else []
    check = best_check(cut.frames, len(cut.start), len(cut.tail), in_front=cut.by_start, whole=numbers)
    if check is None and cut.tail:  # the apparent tail may be the end of every payload
        bare = Cut(cut.rule, cut.start, cut.frames, cut.covered)
        written = [*_drafts(bare, name, source, sender), draft(cut, None, name, source, sender)]
    else:
        written = [draft(cut, check, name, source, sender, with_id=with_id) for with_id in (True, False)]
    return [one for one in written if one is not None]
