"""Messages of the protocol as the types that `wirebond gen --lang ros2` writes for them, and back. Every field has its
place, so no mapping says where it goes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cached_property
from typing import Any

from wirebond.generate.code.ros2_types import FRAME, Definition, Member, interfaces
from wirebond.protocol.model import End, Field, Protocol
from wirebond.ros2 import cdr
from wirebond.ros2.mapping.filler import Reading, Tree
from wirebond.ros2.mapping.grammar import Source
from wirebond.ros2.mapping.model import HEADER_KEY, Filler, Incoming, Outgoing
from wirebond.ros2.mapping.paths import Getter
from wirebond.ros2.mapping.unpacking import UnpackPlan, unpack_plan
from wirebond.ros2.node import Qos
from wirebond.ros2.types import RosType, types_from

_MOST_PLACES = 64  # elements of an array that are packed one by one; a longer one is packed as a whole

_Convert = Callable[[Any], Any]
_Placed = tuple[cdr.Steps, Filler]  # where in the type a value is, and the function that gives it


class OwnTypes:
    """The generated types of one protocol.

    :ivar package: their package, such as ``diffdrive_msgs``.
    """

    def __init__(self, protocol: Protocol) -> None:
        self._found = interfaces(protocol)
        self.package = self._found.package

    @cached_property
    def _types(self) -> dict[str, RosType]:
        return types_from({self._name(one): one.text for one in self._found.definitions})

    def _name(self, definition: Definition) -> str:
        return f"{self.package}/msg/{definition.name}"

    @property
    def names(self) -> list[str]:
        """Return the names of all types, as people write them."""
        return [f"{self.package}/{one.name}" for one in self._found.definitions]

    def named(self, name: str) -> RosType | None:
        """Return the type of this name, of two parts or three; None where there is none.

        :raises UsageError: the package rosbags is not installed.
        """
        package, _, last = name.replace("/msg/", "/").partition("/")
        return self._types.get(f"{package}/msg/{last}") if package == self.package else None

    def of(self, message: str) -> RosType:
        """Return the type of this message of the protocol.

        :raises UsageError: the package rosbags is not installed.
        """
        return self._types[self._name(self._found.messages[message])]

    def tree(self, message: str) -> Tree:
        """Return the sources that fill this message's type."""
        definition = self._found.messages[message]
        tree = Tree(self.of(message))
        for steps, reader in _readers(definition, (), "", _whole):
            tree.put(steps, reader)
        tree.stamp("", "")
        return tree

    def getters(self, message: str) -> tuple[tuple[str, Getter], ...]:
        """Return how to read each field of this message from a message of its type."""
        members = self._found.messages[message].members
        return tuple((m.spec.name, _item(_whole, m.name, _from_ros(m))) for m in members if m.spec is not None)

    def plan(self, message: str) -> UnpackPlan | None:
        """Return how the engine reads them; None: one of them is more than a number."""
        members = [(m.name, m.spec) for m in self._found.messages[message].members if m.spec is not None]
        if not all(_is_one_number(spec) for _, spec in members):
            return None
        if any(spec.enum or spec.flags for _, spec in members):
            return None
        sources = {spec.name: ((name,), Source(path=name)) for name, spec in members}
        return unpack_plan(message, self.of(message), sources)


def _is_one_number(spec: Field) -> bool:
    return (spec.is_number or spec.value_type is bool) and spec.count is None and not spec.is_list


def own_topics(
    protocol: Protocol, own: OwnTypes, sender: End, topic: str, names: Collection[str] | None = None
) -> tuple[Outgoing, ...]:
    """Return a topic of its own type for each message of this sender. ``topic``: its name, ``{}`` where the message's
    stands; ``names``: for these messages alone."""
    found = []
    for message in protocol.messages:
        if message.sent_by(sender) and (names is None or message.name in names):
            name, tree = message.name, own.tree(message.name)
            fill, plan = tree.filler(), tree.plan(name)
            found.append(Outgoing(name, topic.format(name), tree.type, Qos(), 0.0, fill, plan, reads_header=True))
    return tuple(found)


def own_commands(protocol: Protocol, own: OwnTypes, names: Collection[str]) -> tuple[Incoming, ...]:
    """Return a topic of its own type for each of these messages that the host sends. What comes is sent once."""
    return tuple(
        Incoming(f"~/{m.name}/send", own.of(m.name), m.name, Qos(), own.getters(m.name), None, own.plan(m.name))
        for m in protocol.messages
        if m.sent_by(End.HOST) and m.name in names
    )


# ---- to ROS: fields of a message by the places of its type


def _readers(definition: Definition, steps: cdr.Steps, path: str, getter: Getter) -> Iterator[_Placed]:
    """Yield readers. ``path``: the message's field that contains all these, as `wire_leaf` takes it, and its getter."""
    for member in definition.members:
        place = (*steps, member.name)
        if member.spec is not None:
            name = member.spec.name
            yield from _member_readers(member, place, f"{path}.{name}" if path else name, _item(getter, name))
        elif member.name == FRAME and member.of is not None:
            yield from _frame_readers(member.of, place)


def _frame_readers(definition: Definition, steps: cdr.Steps) -> Iterator[_Placed]:
    """Yield a reader for each field of the format; a frame has some of them, and the others are 0."""
    for member in definition.members:
        assert member.spec is not None, "a field of the frame is one of the file"
        yield (*steps, member.name), _frame_reader(member.spec.name, _to_one(member))


def _frame_reader(name: str, convert: _Convert) -> Filler:
    return lambda fields, _: convert(fields[HEADER_KEY].get(name, 0))


def _member_readers(member: Member, steps: cdr.Steps, path: str, getter: Getter) -> Iterator[_Placed]:
    if member.count == 0:
        yield from _one_reader(member, steps, path, getter)
    elif member.count is None or member.count > _MOST_PLACES or _is_text(member):
        convert = _to_value(member)
        yield steps, lambda fields, _: convert(getter(fields))
    else:
        for index in range(member.count):
            yield from _one_reader(member, (*steps, index), f"{path}.{index}", _item(getter, index))


def _one_reader(member: Member, steps: cdr.Steps, path: str, getter: Getter) -> Iterator[_Placed]:
    if member.of is not None:
        yield from _readers(member.of, steps, path, getter)
    else:
        chosen = dict(member.spec.enum) if member.spec is not None else {}
        yield steps, Reading(path, getter, chosen=chosen or None, convert=_to_one(member))


def _is_text(member: Member) -> bool:
    return member.spec is not None and member.spec.is_string


def _to_value(member: Member) -> _Convert:
    """Return a conversion of a field's value to that of its member."""
    convert = _to_one(member)
    return convert if member.count == 0 or _is_text(member) else lambda values: [convert(one) for one in values]


def _to_one(member: Member) -> _Convert:
    """Return the same for one of its elements."""
    spec = member.spec
    if member.of is not None:
        inner = [(m.name, m.spec.name, _to_value(m)) for m in member.of.members if m.spec is not None]
        return lambda values: {name: convert(values[key]) for name, key, convert in inner}
    if spec is not None and spec.enum:
        numbers: dict[Any, int] = dict(spec.enum)
        return lambda value: numbers.get(value, value)  # a number that has no name comes as it is
    if spec is not None and spec.flags:
        bits: dict[Any, int] = {name: 1 << bit for name, bit in spec.flags}
        return lambda values: values if isinstance(values, int) else sum(bits.get(one, one) for one in values)
    return _same


# ---- from ROS


def _from_ros(member: Member) -> _Convert:
    convert = _from_one(member)
    if member.spec is not None and member.spec.value_type is bytes:
        return bytes
    return convert if member.count == 0 else lambda values: [convert(one) for one in values]


def _from_one(member: Member) -> _Convert:
    if member.of is not None:
        inner = [(m.spec.name, m.name, _from_ros(m)) for m in member.of.members if m.spec is not None]
        return lambda values: {name: convert(values[key]) for name, key, convert in inner}
    return _same


def _same(value: Any) -> Any:
    return value


def _whole(values: Mapping[str, Any]) -> Any:
    return values


def _item(getter: Getter, key: str | int, convert: _Convert = _same) -> Getter:
    return lambda values: convert(getter(values)[key])
