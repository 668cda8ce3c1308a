"""Known formats whose frames have another size than their file says: what happens when a firmware gains a field."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from wirebond.analysis.explain.guesses.format import with_payload_size
from wirebond.analysis.explain.layout import payload_index
from wirebond.analysis.explain.shapes import forms
from wirebond.analysis.identify.formats import Format, format_of
from wirebond.analysis.identify.ranking import Candidate, rank
from wirebond.protocol.model import PartKind, PayloadRule

_MOST_SIZES = 2  # of a format that are tried
_LEAST = 3  # times that a distance between two starts comes


@dataclass(frozen=True)
class Resized:
    """``candidate`` fits with payloads of ``size`` bytes in place of the ``told`` ones of ``file``."""

    file: Format
    candidate: Candidate
    size: int
    told: int

    @property
    def sentence(self) -> str:
        """The mismatch, and what to do."""
        off = abs(self.size - self.told)
        much = f"{off} byte{'s' * (off != 1)} {'longer' if self.size > self.told else 'shorter'}"
        return (
            f"{self.file.name} fits if its payload has {self.size} bytes and not {self.told}: the frames are {much} "
            f"than {self.file.model.path} says. Compare its fields with the sender's code."
        )


def resized(formats: Sequence[Format], data: bytes) -> list[Resized]:
    """Return fitting formats with other payload sizes, the best first. Tried are formats whose frames begin with a
    magic and have one size; the sizes are the usual distances between two magics."""
    tried = [one for each in formats for one in _variants(each, data)]
    ranked = rank(data, [variant for _, variant, _, _ in tried])
    of = {id(variant): (each, size, told) for each, variant, size, told in tried}
    return [
        Resized(each, candidate, size, told)
        for candidate in ranked
        if candidate.fits
        for each, size, told in [of[id(candidate.format)]]
    ]


def _variants(each: Format, data: bytes) -> list[tuple[Format, Format, int, int]]:
    model = each.model
    (form, *others) = forms(model, None)
    first, at = form.parts[0], payload_index(form.parts)
    rule = form.parts[at]
    if others or first.kind != PartKind.MAGIC or rule.payload != PayloadRule.FIXED:
        return []
    if model.format.delimiter is not None or model.format.ends_by_silence or model.format.is_sized:
        return []
    beside = sum(part.size for part in form.parts)
    found = []
    for distance in _distances(data, first.value):
        size = distance - beside
        if 0 < size != rule.fixed_payload:
            variant = with_payload_size(model, form.parts, at, size)
            found.append((each, format_of(variant), size, rule.fixed_payload))
    return found


def _distances(data: bytes, start: bytes) -> list[int]:
    places = [found.start() for found in re.finditer(b"(?=%b)" % re.escape(start), data)]
    counts = Counter(after - before for before, after in pairwise(places))
    return [distance for distance, count in counts.most_common(_MOST_SIZES) if count >= _LEAST]
