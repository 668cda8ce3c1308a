"""Describes what a link received in a period, for a request without a reply. No link, no clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_MOST_NAMES = 4


@dataclass(frozen=True)
class Arrivals:
    """
    :ivar messages: how many, by message.
    :ivar unknown: frames of no message of the file.
    :ivar foreign: frames for another address, or from one that was not asked.
    :ivar discarded: bytes by cause.
    """

    messages: Mapping[str, int]
    unknown: int
    foreign: int
    discarded: Mapping[str, int]

    @classmethod
    def between(cls, before: Mapping[str, Any], after: Mapping[str, Any]) -> Arrivals:
        """Compare two receive accounts, as the engine gives them."""

        def more(key: str) -> dict[str, int]:
            counts = {name: count - before[key].get(name, 0) for name, count in after[key].items()}
            return dict(sorted(((n, c) for n, c in counts.items() if c > 0), key=lambda entry: (-entry[1], entry[0])))

        unknown, foreign = (after[key] - before[key] for key in ("unknown_frames", "foreign_frames"))
        messages = more("messages")
        messages.pop("unknown", None)
        return cls(messages, unknown, foreign, more("discarded_bytes"))

    @property
    def has_frames(self) -> bool:
        """Return whether any intact frame arrived."""
        return bool(self.messages or self.unknown or self.foreign)

    @property
    def text(self) -> str:
        """``3 other messages arrived: odometry 2, error 1; 4 bytes were discarded: check_mismatch``; empty if nothing
        arrived."""
        found = []
        if self.messages:
            found.append(f"{_counted(sum(self.messages.values()), 'other message')} arrived: {_listed(self.messages)}")
        if self.unknown:
            found.append(f"{_counted(self.unknown, 'frame')} of unknown messages arrived")
        if self.foreign:
            found.append(f"{_counted(self.foreign, 'frame')} of other addresses arrived")
        if self.discarded:
            total = sum(self.discarded.values())
            causes = next(iter(self.discarded)) if len(self.discarded) == 1 else _listed(self.discarded)
            found.append(f"{_counted(total, 'byte')} {'was' if total == 1 else 'were'} discarded: {causes}")
        return "; ".join(found)


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


def _listed(counts: Mapping[str, int]) -> str:
    shown = [f"{name} {count}" for name, count in counts.items()]
    left = len(shown) - _MOST_NAMES
    return ", ".join(shown) if left <= 1 else f"{', '.join(shown[:_MOST_NAMES])} and {left} more kinds"
