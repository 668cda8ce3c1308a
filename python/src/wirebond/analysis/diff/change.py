"""The parts of a comparison: directions between an old and a new end, changes, and their effects.

What was added can wait until both ends know it, and is compatible. What was removed or changed cannot: an end with the
old file goes on as before.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from wirebond.protocol.model import End, Message, Protocol


class Verdict(StrEnum):
    """Worst first."""

    BREAKS = "breaks"  # somewhere a frame is lost, refused, or read as other values
    COMPATIBLE = "compatible"  # the bytes or their meaning changed, and both ends still understand each other
    HARMLESS = "harmless"  # no byte of the wire changed

    @property
    def rank(self) -> int:
        return list(Verdict).index(self)


@dataclass(frozen=True)
class Flow:
    """Frames from an end with one of the two files to the other end, which has the other file."""

    sender: End
    from_new: bool

    @property
    def receiver(self) -> End:
        return End.MCU if self.sender == End.HOST else End.HOST

    @property
    def new_end(self) -> End:
        """The end that has the new file."""
        return self.sender if self.from_new else self.receiver

    def __str__(self) -> str:
        ages = ("new", "old") if self.from_new else ("old", "new")
        return f"{ages[0]} {end_name(self.sender)} to {ages[1]} {end_name(self.receiver)}"


FLOWS = tuple(Flow(sender, from_new) for from_new in (True, False) for sender in (End.HOST, End.MCU))


def end_name(end: End) -> str:
    return "MCU" if end == End.MCU else end.value


@dataclass(frozen=True)
class Sides:
    """Both protocols, as seen along one direction."""

    flow: Flow
    old: Protocol
    new: Protocol

    @property
    def sender(self) -> Protocol:
        return self.new if self.flow.from_new else self.old

    @property
    def receiver(self) -> Protocol:
        return self.old if self.flow.from_new else self.new

    @property
    def sending(self) -> str:
        """``new host``"""
        return f"{'new' if self.flow.from_new else 'old'} {end_name(self.flow.sender)}"

    @property
    def receiving(self) -> str:
        return f"{'old' if self.flow.from_new else 'new'} {end_name(self.flow.receiver)}"


def all_sides(old: Protocol, new: Protocol) -> list[Sides]:
    return [Sides(flow, old, new) for flow in FLOWS]


@dataclass(frozen=True)
class Effect:
    """The effect of a change on frames of one direction. It may be worth knowing even if it breaks nothing."""

    flow: Flow
    breaks: bool
    sentence: str

    def as_dict(self) -> dict[str, Any]:
        return {
            "sender": self.flow.sender.value,
            "sender_has": "new" if self.flow.from_new else "old",
            "breaks": self.breaks,
            "sentence": self.sentence,
        }


@dataclass(frozen=True)
class Change:
    """A difference between two files. ``place`` leads to it in the new file, or in the old one where it is gone."""

    what: str  # ``velocity.linear``, ``frame``, ``link``
    sentence: str
    verdict: Verdict
    effects: tuple[Effect, ...] = ()
    place: tuple[str | int, ...] = ()
    is_gone: bool = False

    def breaks_between(self, new_end: End) -> bool:
        """Return whether it breaks the link between this end with the new file and the other with the old one."""
        return any(effect.breaks and effect.flow.new_end == new_end for effect in self.effects)

    def as_dict(self) -> dict[str, Any]:
        return {
            "what": self.what,
            "sentence": self.sentence,
            "verdict": self.verdict.value,
            "effects": [effect.as_dict() for effect in self.effects],
        }


def changed(
    what: str, sentence: str, effects: Iterable[Effect] = (), *, place: tuple[str | int, ...] = (), gone: bool = False
) -> Change:
    """Return a change of the wire, with its verdict from its effects."""
    found = tuple(effects)
    verdict = Verdict.BREAKS if any(effect.breaks for effect in found) else Verdict.COMPATIBLE
    return Change(what, sentence, verdict, found, place, gone)


def harmless(what: str, sentence: str, *, place: tuple[str | int, ...] = ()) -> Change:
    return Change(what, sentence, Verdict.HARMLESS, (), place)


def carries(sides: Sides, message: Message) -> bool:
    """Return whether this direction's sender sends this message."""
    return message.sent_by(sides.flow.sender)
