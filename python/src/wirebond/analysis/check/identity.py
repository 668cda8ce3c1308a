"""Finds frames that are hard to distinguish: ids with two meanings, start bytes that are frequent in values."""

from __future__ import annotations

from wirebond.analysis.check.findings import Finding, Severity
from wirebond.analysis.check.frame_facts import has_id
from wirebond.analysis.check.places import Places
from wirebond.protocol.model import PartKind, Protocol
from wirebond.protocol.planning import ids_collide

_FREQUENT = {0x00: "small numbers, zeros and padding", 0xFF: "small negative numbers and an open line"}


def assess_ids(protocol: Protocol, places: Places) -> list[Finding]:
    pairs = ids_collide(protocol)
    if not pairs or not has_id(protocol):
        return []
    first, second = pairs[0]
    place = places.at("messages", second.name, "id")
    more = f", and {len(pairs) - 1} more" if len(pairs) > 1 else ""
    return [
        Finding(
            "shared-id",
            Severity.NOTE,
            f"id 0x{first.id:02X} is `{first.name}` from the {first.sender} and `{second.name}` from the "
            f"{second.sender}{more}",
            "a recording of both directions cannot be decoded as one, and an end that hears its own echo takes it for "
            "the other's",
            "give the MCU's messages ids of their own, such as 0x80 and up, or name the `--sender` when you decode",
            place.line,
            place.column,
        )
    ]


def assess_magic(protocol: Protocol, places: Places) -> list[Finding]:
    magic = protocol.format.part(PartKind.MAGIC)
    values = () if magic is None else (magic.value, *magic.alternatives, *(value for _, value in magic.by_sender))
    value = next((value for value in values if len(set(value)) == 1 and value[0] in _FREQUENT), None)
    if value is None:
        return []
    place = places.part("magic")
    text = " ".join(f"0x{byte:02X}" for byte in value)
    return [
        Finding(
            "frequent-magic",
            Severity.WARNING,
            f"the magic {text} is among the commonest bytes of payloads",
            f"{_FREQUENT[value[0]]} are full of it; after a loss the receiver tries a start at each of them",
            "if the format is yours to change, take bytes such as 0xA5 0x5A",
            place.line,
            place.column,
        )
    ]
