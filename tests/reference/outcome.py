"""What decoding gives, and the two ways in which bytes are no frame."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Frame:
    offset: int
    wire: bytes
    id: int
    name: str  # of the message, or "unknown"
    header: dict[str, object] = field(default_factory=dict)


@dataclass
class Result:
    frames: list[Frame] = field(default_factory=list)
    fill_bytes: int = 0
    discarded_bytes: Counter[str] = field(default_factory=Counter)
    rejected_candidates: Counter[str] = field(default_factory=Counter)


@dataclass(frozen=True)
class Rejected(Exception):  # noqa: N818  (an outcome, not an error)
    cause: str
    extent: int


class Incomplete(Exception):  # noqa: N818
    """``size``: of the whole frame, where that is known."""

    def __init__(self, size: int = 0) -> None:
        self.size = size
