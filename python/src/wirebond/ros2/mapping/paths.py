"""Paths such as ``state.estop`` or ``transforms.0.transform.rotation.x``: what they lead to, and its type."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from wirebond.protocol.model import Field, Message
from wirebond.protocol.problems import suggestion
from wirebond.ros2.types import RANGES, Kind, RosField, RosType

_MOST_DIGITS = 9  # of an index


class What(StrEnum):
    """The type of a value, as a sentence calls it."""

    BOOL = "true or false"
    INTEGER = "an integer"
    NUMBER = "a number"
    TEXT = "a text"
    NAME = "a name"  # of an enum; a number where it has none
    BYTES = "bytes"
    FLAGS = "flags"
    GROUP = "a group of fields"


@dataclass(frozen=True)
class Leaf:
    """The value at the end of a path.

    :ivar count: of a list of these values: how many there are; None where that varies. 0: one value, no list.
    :ivar choices: names and words that it can be, where they are known.
    """

    path: str
    what: What
    minimum: float = -math.inf
    maximum: float = math.inf
    count: int | None = 0
    choices: tuple[str, ...] = ()

    @property
    def is_list(self) -> bool:
        """Are these several values?"""
        return self.count != 0

    @property
    def described(self) -> str:
        """With its article: ``a list of 4 numbers``."""
        if not self.is_list:
            return str(self.what)
        plural = {What.BOOL: "true or false"}.get(self.what, str(self.what).split(" ", 1)[-1] + "s")
        return f"a list of {plural}" if self.count is None else f"a list of {self.count} {plural}"


class PathError(Exception):
    """A path leads nowhere; the text says where it ends, and what could follow."""


Getter = Callable[[Mapping[str, Any]], Any]


# ---- messages of the protocol


def wire_leaf(message: Message, path: str) -> tuple[Leaf, Getter]:
    """Return the value at this path of a message, and how to read it from the message's fields.

    :raises PathError: to nothing.
    """
    fields, where, steps = message.fields, message.name, path.split(".")
    getter: Getter = _whole
    while True:
        step = steps.pop(0)
        names = [f.name for f in fields if f.has_value]
        if step not in names:
            raise PathError(f"{where} has no field `{step}`; {suggestion(step, names)}")
        found = next(f for f in fields if f.name == step)
        getter, where = _item(getter, step), f"{where}.{step}"
        many = found.count is not None or found.is_list
        if many and steps and steps[0].isdecimal():
            if found.count is None or len(steps[0]) > _MOST_DIGITS or int(steps[0]) >= found.count:
                held = "a varying number of" if found.count is None else str(found.count)
                raise PathError(f"{where} has {held} values; an index is a number below that")
            getter, where, many = _item(getter, int(steps[0])), f"{where}.{steps.pop(0)}", False
        if not steps:
            return _leaf_of(path, found, many), getter
        if found.flags and len(steps) == 1 and not many:
            flags = [name for name, _ in found.flags]
            if steps[0] not in flags:
                raise PathError(f"{where} has no flag `{steps[0]}`; {suggestion(steps[0], flags)}")
            return Leaf(path, What.BOOL, 0, 1), _flag(getter, steps[0])
        if many or found.value_type is not dict:
            kind = _leaf_of(path, found, many).described
            raise PathError(f"{where} is {kind}, and has no `{steps[0]}`; end the path there")
        fields = found.fields


def _leaf_of(path: str, field: Field, many: bool) -> Leaf:
    count = (field.count if not field.is_list else None) if many else 0
    if field.value_type is dict:
        return Leaf(path, What.GROUP, count=count)
    if field.value_type is bool:
        return Leaf(path, What.BOOL, 0, 1, count)
    if field.value_type is str:
        return Leaf(path, What.TEXT, count=count)
    if field.value_type is bytes:
        return Leaf(path, What.BYTES, 0, 255, count)
    if field.flags:
        return Leaf(path, What.FLAGS, count=count, choices=tuple(name for name, _ in field.flags))
    if field.enum:
        return Leaf(path, What.NAME, count=count, choices=tuple(name for name, _ in field.enum))
    if field.value_type is float:
        return Leaf(path, What.NUMBER, count=count)
    least, greatest = field.whole_limits
    return Leaf(path, What.INTEGER, least, greatest, count)


def _whole(fields: Mapping[str, Any]) -> Any:
    return fields


def _item(getter: Getter, key: str | int) -> Getter:
    if getter is _whole:
        return lambda fields: fields[key]  # type: ignore[index]
    return lambda fields: getter(fields)[key]


def _flag(getter: Getter, name: str) -> Getter:
    return lambda fields: name in getter(fields)


# ---- messages of ROS 2


@dataclass(frozen=True)
class RosPlace:
    """A place in a message of ROS 2.

    :ivar steps: names, and indexes as integers.
    :ivar owner: the type that has its last field.
    """

    steps: tuple[str | int, ...]
    field: RosField
    owner: RosType
    leaf: Leaf


def ros_place(type_: RosType, path: str) -> RosPlace:
    """Return the value at this path of a message type.

    :raises PathError: to nothing, or to something that has no one value.
    """
    owner, steps = type_, path.split(".")
    found: list[str | int] = []
    while True:
        step = steps.pop(0)
        field = owner.field(step)
        if field is None:
            raise PathError(f"{owner.short} has no field `{step}`; {suggestion(step, [f.name for f in owner.fields])}")
        found.append(step)
        many = field.kind != Kind.ONE
        if many and steps and steps[0].isdecimal():
            index = int(steps.pop(0)[:_MOST_DIGITS])
            if (field.kind == Kind.ARRAY and index >= field.count) or index > 63:
                raise PathError(
                    f"{step} of {owner.short} is {field.spelled}; an index is a number below its size, and 64"
                )
            found.append(index)
            many = False
        if not steps:
            return RosPlace(tuple(found), field, owner, _ros_leaf(path, field, many))
        if field.of is None or many:
            kind = field.spelled if not many or field.of is None else f"{field.spelled}: write `{step}.0.…`"
            raise PathError(f"{step} of {owner.short} is {kind}, and has no `{steps[0]}`; correct the path")
        owner = field.of


def _ros_leaf(path: str, field: RosField, many: bool) -> Leaf:
    count = (field.count if field.kind == Kind.ARRAY else None) if many else 0
    if field.of is not None:
        return Leaf(path, What.GROUP, count=count, choices=tuple(f.name for f in field.of.fields))
    if field.base == "bool":
        return Leaf(path, What.BOOL, 0, 1, count)
    if field.base in ("string", "wstring"):
        return Leaf(path, What.TEXT, count=count)
    if field.base.startswith("float"):
        return Leaf(path, What.NUMBER, count=count)
    low, high = RANGES[field.base]
    if many and field.base in ("uint8", "char", "byte"):
        return Leaf(path, What.BYTES if count is None else What.INTEGER, low, high, count=0 if count is None else count)
    return Leaf(path, What.INTEGER, low, high, count)


def ros_getter(steps: tuple[str | int, ...]) -> Getter:
    """Return how to read the value at this place from a received message.

    The getter raises IndexError where a sequence is shorter than the path says.
    """
    getter: Getter = _whole
    for step in steps:
        getter = _item(getter, step)
    return getter


def misfit(target: Leaf, given: Leaf) -> str:
    """Return why a value of one type cannot be used for the other; empty if it can."""
    sentence = f"{given.path} is {given.described}, and {target.path} takes {target.described}"
    if target.is_list != given.is_list or (target.count and given.count is not None and target.count != given.count):
        return sentence
    if target.what == What.INTEGER and given.what == What.INTEGER:
        if given.minimum < target.minimum or given.maximum > target.maximum:
            return f"{sentence} from {target.minimum:.0f} to {target.maximum:.0f}"
        return ""
    return "" if given.what in _FITS.get(target.what, ()) else sentence


_FITS: dict[What, tuple[What, ...]] = {
    What.BOOL: (What.BOOL,),
    What.NUMBER: (What.NUMBER, What.INTEGER),
    What.TEXT: (What.TEXT, What.NAME),
    What.NAME: (What.TEXT, What.INTEGER),
    What.BYTES: (What.BYTES,),
    What.FLAGS: (What.INTEGER,),
    What.INTEGER: (),
    What.GROUP: (),
}
