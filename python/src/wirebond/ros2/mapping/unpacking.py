"""Prepares a topic's bytes for the engine, which makes a message's frame of them: how to walk through them, and what to
take.

Made once from a mapping. `wirebond._engine.CdrCommand` applies it; what it cannot, the mapping's getters do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from wirebond.ros2.cdr import CODES, Steps
from wirebond.ros2.mapping.grammar import Source
from wirebond.ros2.types import Kind, RosField, RosType

TEXT = "s"


@dataclass(frozen=True)
class Part:
    """A field of a topic, in the order of its bytes.

    :ivar code: the type of a number, as `struct` has it; ``s``: a text; empty: a message, whose fields are ``inside``.
    :ivar slot: where its value is kept while the others are read; -1: nowhere.
    :ivar picked: elements that are walked through in another way than the others, because values are within.
    """

    kind: Kind
    code: str
    count: int = 0
    inside: tuple[Part, ...] = ()
    slot: int = -1
    picked: tuple[tuple[int, Part], ...] = ()


@dataclass(frozen=True)
class UnpackedValue:
    """A field of the message."""

    name: str
    slot: int
    scale: float
    offset: float


@dataclass(frozen=True)
class UnpackPlan:
    """A topic whose values are numbers and texts.

    :ivar parts: of the topic's type, all of them: bytes that end too soon are not a message.
    :ivar constants: fields of the message that no topic gives.
    """

    message: str
    parts: tuple[Part, ...]
    values: tuple[UnpackedValue, ...]
    constants: dict[str, Any]


def unpack_plan(message: str, type_: RosType, sources: Mapping[str, tuple[Steps, Source]]) -> UnpackPlan | None:
    """Plan how to unpack values; None if one is neither number nor text, is chosen by another, or has a type that
    Wirebond does not read.

    :param sources: by the message's fields: places in the topic, none for a constant.
    """
    if any(source.choose for _, source in sources.values()):
        return None
    slots = {steps: slot for slot, steps in enumerate(dict.fromkeys(steps for steps, _ in sources.values() if steps))}
    try:
        parts = _parts(type_, (), slots)
    except LookupError:
        return None
    if {slot for part in parts for slot in _slots(part)} != set(slots.values()):  # one is a list
        return None
    values = [
        UnpackedValue(name, slots[steps], source.scale, source.offset)
        for name, (steps, source) in sources.items()
        if steps
    ]
    constants = {name: source.constant for name, (steps, source) in sources.items() if not steps}
    return UnpackPlan(message, parts, tuple(values), constants)


def _parts(type_: RosType, path: Steps, slots: Mapping[Steps, int]) -> tuple[Part, ...]:
    return tuple(_part(field, (*path, field.name), slots) for field in type_.fields)


def _part(field: RosField, path: Steps, slots: Mapping[Steps, int]) -> Part:
    """Return the part of a field.

    :raises LookupError: it is of a type that Wirebond does not read.
    """
    if field.kind == Kind.ONE:
        return _one(field, path, slots)
    indexes = sorted({steps[len(path)] for steps in slots if len(steps) > len(path) and steps[: len(path)] == path})
    picked = tuple((int(index), _one(field, (*path, index), slots)) for index in indexes)
    return replace(_one(field, (*path, -1), slots), kind=field.kind, count=field.count, picked=picked)


def _one(field: RosField, path: Steps, slots: Mapping[Steps, int]) -> Part:
    if field.of is not None:
        return Part(Kind.ONE, "", inside=_parts(field.of, path, slots))
    code = TEXT if field.base == "string" else CODES[field.base]
    return Part(Kind.ONE, code, slot=slots.get(path, -1))


def _slots(part: Part) -> set[int]:
    within = [*part.inside, *(one for _, one in part.picked)]
    return {slot for each in within for slot in _slots(each)} | ({part.slot} - {-1})
