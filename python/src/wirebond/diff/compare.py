"""The comparison of two protocols as a whole."""

from __future__ import annotations

from dataclasses import dataclass

from wirebond.diff.behaviour import behaviour_changes
from wirebond.diff.change import Change, Effect, Verdict, all_sides, changed
from wirebond.diff.frames import frame_changes
from wirebond.diff.messages import message_changes
from wirebond.protocol.hash import protocol_hash
from wirebond.protocol.model import End, Protocol


@dataclass(frozen=True)
class Comparison:
    """All changes, worst first, in the order of the files."""

    old: Protocol
    new: Protocol
    changes: tuple[Change, ...]

    def number_of(self, verdict: Verdict) -> int:
        return sum(change.verdict == verdict for change in self.changes)

    def works(self, new_end: End) -> bool:
        """Does this end with the new file understand the other with the old one, and is it understood?"""
        return not any(change.breaks_between(new_end) for change in self.changes)


def compare(old: Protocol, new: Protocol) -> Comparison:
    """What the change from ``old`` to ``new`` does to a link whose ends have one of them each."""
    routes = all_sides(old, new)
    changes = [
        *frame_changes(old, new, routes),
        *message_changes(old, new, routes),
        *behaviour_changes(old, new, routes),
    ]
    on_wire = any(change.verdict != Verdict.HARMLESS for change in changes)
    if not on_wire and protocol_hash(old) != protocol_hash(new):
        # A difference that no rule above knows: better a wrong alarm than none.
        effects = [Effect(sides.flow, True, "it may be read otherwise") for sides in routes]
        changes.append(changed("hash", "the files differ in what bytes mean", effects))
    return Comparison(old, new, tuple(sorted(changes, key=lambda change: change.verdict.rank)))
