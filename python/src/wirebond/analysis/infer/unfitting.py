"""Describes bytes that no known format fits as its file says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from wirebond.analysis.identify.formats import Format
from wirebond.analysis.identify.ranking import Candidate
from wirebond.analysis.identify.resized import Resized, resized
from wirebond.analysis.infer.inference import Inference, infer

FEW_BYTES = 200  # too few to see anything in them


@dataclass(frozen=True)
class Unfitting:
    """``near``: formats that fit with payloads of another size. ``seen``: where there are none, what repeats."""

    near: tuple[Resized, ...] = ()
    seen: Inference | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return it as a dictionary for JSON."""
        return {
            "other_sizes": [
                {"format": one.file.name, "file": one.file.model.path, "payload": one.size, "told": one.told}
                for one in self.near
            ],
            "inferred": None if self.seen is None else self.seen.text,
        }


def look_at_unfitting(data: bytes, formats: Sequence[Format], candidates: Sequence[Candidate]) -> Unfitting:
    """Infer a format of bytes that no known one fits. Empty if one fits, if there are few bytes, or if only one frame
    repeats. Takes some seconds.

    :param formats: all that were tried.
    :param candidates: those that are in the bytes, as ``rank`` has found them.
    """
    if any(one.fits for one in candidates):
        return Unfitting()
    near = resized(formats, data)
    if near:
        return Unfitting(near=tuple(near))
    if len(data) < FEW_BYTES or any(one.repeats for one in candidates):
        return Unfitting()
    return Unfitting(seen=infer(data))
