"""From the fields of a message to a message of ROS 2: which value goes where, worked out once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from wirebond.ros2 import cdr
from wirebond.ros2.cdr import default_of
from wirebond.ros2.mapping.grammar import Source
from wirebond.ros2.mapping.model import Filler
from wirebond.ros2.mapping.packing import PackedValue, PackPlan, packed_choices
from wirebond.ros2.mapping.paths import Getter
from wirebond.ros2.types import Kind, RosField, RosType

_HEADER = "std_msgs/msg/Header"
_seconds, _nanoseconds = object(), object()  # the two numbers of a stamp


class Tree:
    """A message type that is being filled: values by name, trees by name, and trees by name and index."""

    def __init__(self, type_: RosType) -> None:
        self.type = type_
        self._values: dict[str, Filler | Any] = {}
        self._trees: dict[str, Tree] = {}
        self._lists: dict[str, dict[int, Any]] = {}

    def put(self, steps: tuple[str | int, ...], value: Any) -> None:
        """Let this function of fields and stamp give the value at this place."""
        name, rest = str(steps[0]), steps[1:]
        field = self.type.field(name)
        assert field is not None, "the path was looked up"
        if not rest:
            self._values[name] = value
        elif isinstance(rest[0], int):
            items = self._lists.setdefault(name, {})
            if len(rest) == 1:
                items[rest[0]] = value
            else:
                assert field.of is not None, "the path was looked up"
                items.setdefault(rest[0], Tree(field.of)).put(rest[1:], value)
        else:
            assert field.of is not None, "the path was looked up"
            self._trees.setdefault(name, Tree(field.of)).put(rest, value)

    def stamp(self, frame: str, child_frame: str) -> int:
        """Fill every header and child_frame_id that the file does not fill itself; how many headers there are."""
        count = 0
        header = self.type.field("header")
        if header is not None and header.of is not None and header.of.name == _HEADER and header.kind == Kind.ONE:
            count += 1
            tree = self._trees.setdefault("header", Tree(header.of))
            tree._values.setdefault("stamp", _stamp)
            tree._values.setdefault("frame_id", Constant(frame))
        if child_frame and self.type.field("child_frame_id") is not None:
            self._values.setdefault("child_frame_id", Constant(child_frame))
        inner = [*self._trees.values(), *(t for items in self._lists.values() for t in items.values())]
        return count + sum(tree.stamp(frame, child_frame) for tree in inner if isinstance(tree, Tree))

    def plan(self, message: str) -> PackPlan | None:
        """Return the engine's form of `filler`; None if a changing value has no fixed size."""
        readers = dict(self._readers(()))
        if None in readers.values():
            return None
        empty = {steps: read.value if isinstance(read, Constant) else 0 for steps, read in readers.items()}
        whole = self._with(empty)
        places = cdr.places_of(self.type, whole)
        seconds = tuple(places[steps][0] for steps, read in readers.items() if read is _seconds)
        nanoseconds = tuple(places[steps][0] for steps, read in readers.items() if read is _nanoseconds)
        values: list[PackedValue] = []
        for steps, read in readers.items():
            if isinstance(read, Constant) or read in (_seconds, _nanoseconds):
                continue
            if not isinstance(read, Reading):
                return None
            at, code = places[steps]
            chosen = None if read.chosen is None else packed_choices(code, read.chosen)
            if read.chosen is not None and chosen is None:
                return None
            values.append(PackedValue(at, code, tuple(read.path.split(".")), read.scale, read.offset, chosen))
        return PackPlan(message, cdr.encode(self.type, whole), seconds, nanoseconds, tuple(values))

    def _readers(self, path: cdr.Steps) -> Iterator[tuple[cdr.Steps, Any]]:
        """Yield each filled place with the source of its value; None: it has no fixed size."""
        for name, value in self._values.items():
            if name in self._trees:  # `filler` takes that
                continue
            if value is _stamp:
                yield (*path, name, "sec"), _seconds
                yield (*path, name, "nanosec"), _nanoseconds
            else:
                yield (*path, name), self._if_fixed(name, value, in_list=False)
        for name, tree in self._trees.items():
            yield from tree._readers((*path, name))
        for name, items in self._lists.items():
            for index, item in items.items():
                place = (*path, name, index)
                yield from (
                    item._readers(place)
                    if isinstance(item, Tree)
                    else ((place, self._if_fixed(name, item, in_list=True)),)
                )

    def _if_fixed(self, name: str, reader: Any, *, in_list: bool) -> Any:
        """Return the reader; None where it gives values of several sizes."""
        field = self.type.field(name)
        assert field is not None, "the path was looked up"
        is_number = field.base not in ("", "string", "wstring") and (in_list or field.kind == Kind.ONE)
        return reader if is_number or isinstance(reader, Constant) else None

    def _with(self, values: Mapping[cdr.Steps, Any]) -> dict[str, Any]:
        """Return the message with these values."""
        copy = Tree(self.type)
        for steps, value in values.items():
            copy.put(steps, Constant(value))
        return copy.filler()({}, {})

    def filler(self) -> Filler:
        """Return one function for all of it."""
        parts = [
            *self._values.items(),
            *((name, tree.filler()) for name, tree in self._trees.items()),
            *((name, self._list(name, items)) for name, items in self._lists.items()),
        ]

        def fill(fields: Mapping[str, Any], stamp: Mapping[str, int]) -> dict[str, Any]:
            return {name: part(fields, stamp) for name, part in parts}

        return fill

    def _list(self, name: str, items: dict[int, Any]) -> Any:
        field = self.type.field(name)
        assert field is not None, "the path was looked up"
        size = field.count if field.kind == Kind.ARRAY else max(items) + 1
        empty = Constant(_element_default(field))
        parts = [items.get(index, empty) for index in range(size)]
        fillers = [part.filler() if isinstance(part, Tree) else part for part in parts]
        return lambda fields, stamp: [part(fields, stamp) for part in fillers]


def source_reader(source: Source, getter: Getter | None, constants: Mapping[str, Any], as_text: bool) -> Any:
    """Return the function that gives a source's value."""
    if getter is None:
        return Constant(source.constant)
    chosen = None
    if source.choose:
        chosen = {
            key: constants.get(value, value) if isinstance(value, str) else value
            for key, value in source.choose.items()
        }
    return Reading(source.path, getter, source.scale, source.offset, chosen, as_text)


@dataclass(frozen=True, slots=True)
class Reading:
    """Gives the value of one field.

    :ivar chosen: the replacement of each of its values; None: the value itself.
    :ivar as_text: a name becomes a text.
    :ivar convert: of a field whose value is not a number, such as flags: makes one of it, as the wire has it.
    """

    path: str
    getter: Getter
    scale: float = 1.0
    offset: float = 0.0
    chosen: Mapping[str, Any] | None = None
    as_text: bool = False
    convert: Callable[[Any], Any] | None = None

    def __call__(self, fields: Mapping[str, Any], _stamp: Any) -> Any:
        value = self.getter(fields)
        if self.convert is not None:
            return self.convert(value)
        if self.chosen is not None:
            return self.chosen[word_of(value)]
        if self.scale != 1.0 or self.offset != 0.0:
            return value * self.scale + self.offset
        return str(value) if self.as_text else value


def word_of(value: Any) -> str:
    """Return the value as a key of `values`."""
    return ("true" if value else "false") if isinstance(value, bool) else str(value)


@dataclass(frozen=True, slots=True)
class Constant:
    """Gives the same value for every message."""

    value: Any

    def __call__(self, _fields: Any, _stamp: Any) -> Any:
        return self.value


def _stamp(_fields: Mapping[str, Any], stamp: Mapping[str, int]) -> Any:
    return stamp


def _element_default(field: RosField) -> Any:
    return default_of(RosField(field.name, Kind.ONE, field.base, field.of))
