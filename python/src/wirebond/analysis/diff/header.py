"""The frame's own fields of two protocols that have the same bits: what these mean, and whose they are."""

from __future__ import annotations

from collections.abc import Iterator

from wirebond.analysis.diff.addresses import same_number
from wirebond.analysis.diff.change import Change, Effect, Sides, changed
from wirebond.analysis.diff.fields import number_changes
from wirebond.analysis.diff.where import Where
from wirebond.protocol.model import Part, Protocol
from wirebond.protocol.model.forms import header_fields
from wirebond.protocol.planning import plan_for


def header_changes(old: Protocol, new: Protocol, routes: list[Sides]) -> Iterator[Change]:
    """Yield the changes of header fields. A field of another size moves everything after it, which the parts report."""
    before = {field.name: field.value for field in header_fields(old.format.parts)}
    for field in header_fields(new.format.parts):
        was = before.get(field.name)
        if was is not None and was.width == field.value.width:
            place = _place(new.format.parts, field.name)
            yield from number_changes(was, field.value, Where(f"header {field.name}", place, tuple(routes), None))
    swapped = {sides.flow: _swapped(sides) for sides in routes}
    if any(swapped.values()):
        effects = [Effect(flow, True, fault) for flow, fault in swapped.items() if fault]
        yield changed("frame", "header fields lie at the places of others", effects, place=("frame",))


def _place(parts: tuple[Part, ...], name: str) -> tuple[str | int, ...]:
    for index, part in enumerate(parts):
        if part.header is not None and part.header.name == name:
            return ("frame", index)
        if any(run.header is not None and run.header.name == name for run in part.bits):
            return ("frame", index, "fields", name)
    return ("frame",)


def _swapped(sides: Sides) -> str:
    """Name the sender's field that the receiver reads as another field of the sender; empty if there is none."""
    sending, reading = (plan_for(side, sides.flow.sender) for side in (sides.sender, sides.receiver))
    for place, field in enumerate(reading.header):
        entry = same_number(sending, reading, place)
        names = {other.name for other in sending.header}
        if entry is not None and entry.name != field.name and field.name in names:
            return f"its {entry.name} is read as {field.name}"
    return ""
