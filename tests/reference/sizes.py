"""The longest frame of a format, tried out over every header that could make a difference."""

from __future__ import annotations

import itertools

from tests.reference.conditions import Header, telling_values, truth
from tests.reference.header import magics_of
from tests.reference.stuffing import overhead
from wirebond.protocol.model import BitRole, End, Part, PartKind, Protocol, Subject


def longest_frame(protocol: Protocol, sender: End | None) -> int:
    """Of all forms of this sender's frames the longest, before stuffing."""
    return longest_together(protocol.format.parts, sender) + protocol.format.max_payload_from(sender)


def longest_together(parts: tuple[Part, ...], sender: End | None) -> int:
    """The most bytes that these parts have together, whichever of them are there: every header is tried that could
    make a difference."""
    conditions = [part.condition for part in parts if part.condition is not None]
    compared = list(dict.fromkeys(c for condition in conditions for c in condition.comparisons))
    magics = [value for part in parts if part.kind == PartKind.MAGIC for value in magics_of(part, sender)] or [b""]
    names = list(
        dict.fromkeys((c.subject, c.name) for c in compared if c.subject not in (Subject.MAGIC, Subject.SENDER))
    )
    longest = 0
    for end, magic in itertools.product((End.HOST, End.MCU) if sender is None else (sender,), magics):
        for values in itertools.product(
            *(telling_values([c for c in compared if (c.subject, c.name) == n], _most(parts, *n)) for n in names)
        ):
            known = dict(zip(names, values, strict=True))
            header = Header(sender=end, magic=magic)
            size = 0
            for part in parts:
                if part.condition is not None and truth(part.condition, header, frozenset(), known) is not True:
                    continue
                size += part.size
                for name in (part.name, *(run.name for run in part.bits)):
                    header.numbers[name] = known.get((Subject.FIELD, name), 0)
                if part.kind == PartKind.ID or any(run.role == BitRole.ID for run in part.bits):
                    header.id = known.get((Subject.ID, ""), 0)
            longest = max(longest, size)
    return longest


def _most(parts: tuple[Part, ...], subject: Subject, name: str) -> int:
    """The greatest value of what is compared."""
    if subject == Subject.SIZE:
        return 0xFFFF
    wholes = [part.size for part in parts if (part.kind == PartKind.ID if subject == Subject.ID else part.name == name)]
    role = BitRole.ID if subject == Subject.ID else None
    runs = [run.mask for part in parts for run in part.bits if (run.role == role if role else run.name == name)]
    return max([*(256**size - 1 for size in wholes), *runs])


def longest_on_wire(protocol: Protocol, sender: End | None) -> int:
    longest = longest_frame(protocol, sender)
    closing = protocol.format.delimiter or b""
    return longest + overhead(protocol, longest) + len(protocol.format.opening or closing) + len(closing)
