"""The comparison of two protocols as a whole."""

from __future__ import annotations

from dataclasses import dataclass, replace

from wirebond.analysis.diff.behaviour import behaviour_changes
from wirebond.analysis.diff.change import Change, Effect, Verdict, all_sides, changed
from wirebond.analysis.diff.frames import frame_changes
from wirebond.analysis.diff.header import header_changes
from wirebond.analysis.diff.messages import message_changes
from wirebond.protocol.hash import protocol_hash
from wirebond.protocol.model import ByteOrder, End, Field, HeaderField, Match, Part, Protocol


@dataclass(frozen=True)
class Comparison:
    """The changes, worst first, in the order of the files."""

    old: Protocol
    new: Protocol
    changes: tuple[Change, ...]

    def number_of(self, verdict: Verdict) -> int:
        return sum(change.verdict == verdict for change in self.changes)

    def works(self, new_end: End) -> bool:
        """Return whether this end with the new file and the other with the old one understand each other."""
        return not any(change.breaks_between(new_end) for change in self.changes)


def compare(old: Protocol, new: Protocol) -> Comparison:
    """Return the effect of the change from ``old`` to ``new`` on a link with one end of each."""
    one, other = _without_order_of_a_byte(old), _without_order_of_a_byte(new)
    routes = all_sides(one, other)
    changes = [
        *frame_changes(one, other, routes),
        *header_changes(one, other, routes),
        *message_changes(one, other, routes),
        *behaviour_changes(one, other, routes),
    ]
    on_wire = any(change.verdict != Verdict.HARMLESS for change in changes)
    if not on_wire and protocol_hash(one) != protocol_hash(other):
        # A difference that no rule above knows: better a wrong alarm than none.
        effects = [Effect(sides.flow, True, "it may be read otherwise") for sides in routes]
        changes.append(changed("hash", "the files differ in the meaning of bytes", effects))
    return Comparison(old, new, tuple(sorted(changes, key=lambda change: change.verdict.rank)))


def _without_order_of_a_byte(protocol: Protocol) -> Protocol:
    """Remove `byte_order` from numbers of one byte; the file's order is stored at each number."""

    def plain_match(match: Match) -> Match:
        if match.place is None or match.place.bytes > 1:
            return match
        return replace(match, place=replace(match.place, order=ByteOrder.LITTLE))

    def plain_field(field: Field) -> Field:
        order = ByteOrder.LITTLE if field.size <= 1 else field.order
        return replace(field, order=order, fields=tuple(map(plain_field, field.fields)))

    def plain_header(header: HeaderField | None) -> HeaderField | None:
        return None if header is None else replace(header, value=plain_field(header.value))

    def plain_part(part: Part) -> Part:
        order = ByteOrder.LITTLE if part.size == 1 else part.order
        bits = tuple(replace(run, header=plain_header(run.header)) for run in part.bits)
        return replace(part, order=order, bits=bits, header=plain_header(part.header))

    messages = tuple(
        replace(m, match=tuple(map(plain_match, m.match)), fields=tuple(map(plain_field, m.fields)))
        for m in protocol.messages
    )
    parts = tuple(map(plain_part, protocol.format.parts))
    return replace(protocol, messages=messages, format=replace(protocol.format, parts=parts))
