"""The content of an explanation: plain values, for a terminal, JSON or a document. Nothing is computed here."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any


class State(StrEnum):
    """Whether the content of a row is right."""

    GOOD = "good"  # a rule was applied and holds
    WRONG = "wrong"  # this is where the frame was refused, or a field breaks its rule
    NAMED = "named"  # no rule concerns it, or none was reached


@dataclass(frozen=True)
class Row:
    """A run of bytes and its name. ``level`` 0: a part of the frame, or bytes around it; 1: a field; 2: a field
    of that, and so on. A value among the bits of a number has no bytes of its own: they are in the row before.

    ``data`` is what the wire bytes are after unstuffing; equal to ``wire`` where nothing is stuffed.
    """

    name: str
    level: int
    offset: int  # of the first wire byte, in all that was given
    wire: bytes
    data: bytes
    meaning: str
    state: State


@dataclass(frozen=True)
class Applied:
    """A rule of the format, as applied."""

    rule: str
    expected: str
    found: str
    holds: bool


class Changes(StrEnum):
    """The changes that a guess makes."""

    NOTHING = ""  # in the file: the guess is about this frame alone
    SENDER = "sender"  # whose bytes they are taken for
    FORMAT = "format"
    CHECK = "check"  # the file would compute it in another way


@dataclass(frozen=True)
class FittingGuess:
    """A guess that was tried and fits. ``chance``: that one of the ``tried`` guesses of its kind would
    fit bytes that have nothing to do with it; None where nothing had to be guessed. A change to the file is judged by
    all the bytes: ``fits`` of ``of`` candidates that were refused, or would be by the change, are frames with it."""

    what: str
    remedy: str
    reading: str  # the meaning of the bytes with the change; empty if they still have none
    tried: int
    chance: float | None
    others: int = 0  # further guesses of the same kind that fit as well
    fits: int = 1
    of: int = 1
    changes: Changes = Changes.NOTHING


class Kind(StrEnum):
    FRAME = "frame"
    REFUSED = "refused"
    NOISE = "noise"  # nothing in it begins a frame
    FILL = "fill"  # delimiters between frames


@dataclass(frozen=True)
class Stretch:
    """Bytes with one outcome. ``cause``: the decoder's word for the outcome of the candidate at its start; empty for
    frames and fill. Later bytes may carry other causes: ``Explanation.discarded_bytes`` counts each by its own."""

    kind: Kind
    offset: int
    wire: bytes
    cause: str
    summary: str
    rows: tuple[Row, ...] = ()
    rules: tuple[Applied, ...] = ()
    message: str = ""  # frames: its message, or "unknown"
    values: dict[str, Any] = field(default_factory=dict)
    header: dict[str, Any] = field(default_factory=dict)  # frames: the frame's own named fields
    faults: tuple[str, ...] = ()  # field rules that are broken; the frame is delivered all the same
    guesses: tuple[FittingGuess, ...] = ()
    repaired: str = ""  # the frame's meaning if only its check values are wrong
    tried: int = 0  # guesses
    searched_all: bool = True  # False: the search was cut short


@dataclass(frozen=True)
class Explanation:
    """All given bytes in order, each in exactly one stretch."""

    protocol: str
    sender: str | None
    stretches: tuple[Stretch, ...]
    discarded_bytes: dict[str, int]
    rejected_candidates: dict[str, int]

    @property
    def together(self) -> tuple[FittingGuess, ...]:
        """The changes to the file that make frames of several candidates: what fits most comes first. Each once."""
        found = {guess.remedy or guess.what: guess for stretch in self.stretches[::-1] for guess in stretch.guesses}
        return tuple(sorted((g for g in found.values() if g.fits > 1), key=lambda g: -g.fits))

    @property
    def frames(self) -> tuple[Stretch, ...]:
        return tuple(stretch for stretch in self.stretches if stretch.kind == Kind.FRAME)
