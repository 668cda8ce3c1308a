"""Short forms of the file, written out before anything else reads it: `speed: i16` is `speed: {type: i16}`.

There are two: a field as a text, and a service of one message as that message's name. All that comes after this step
knows the long forms alone. A text that is neither stays as it is, for the grammar to report.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

from wirebond.protocol.text.field_types import is_field_type
from wirebond.protocol.text.yaml_tree import Entry, Mapping, Node, Number, Scalar, value_of

ONE_MESSAGE = ("hello", "log", "counters")  # services

_Change = Callable[[Node], Node]


def written_out(root: Node) -> Node:
    """Return the same file without short forms. Text keeps its place."""
    if not isinstance(root, Mapping):
        return root
    types = root.get("types")
    fields = _Fields(types.entries if isinstance(types, Mapping) else ())
    messages = _under("fields", fields.all)
    root = _under("types", _each(fields.all))(root)
    root = _under("messages", _each(messages))(root)
    return _under("services", _services)(root)


class _Fields:
    """:param types: names of the file's types, each of which may be used as a struct."""

    def __init__(self, types: Collection[str]) -> None:
        self._types = types

    def all(self, fields: Node) -> Node:
        return _each(self._one)(fields)

    def _one(self, field: Node) -> Node:
        if isinstance(field, Scalar):
            return self._of_text(field)
        field = _under("struct", self.all)(field)
        field = _under("group", _under("fields", self.all))(field)
        return _under("bits", _under("fields", _each(_bit_field)))(field)

    def _of_text(self, field: Scalar) -> Node:
        word, _, rest = str(field.value).partition(" ")
        is_struct = word in self._types and not is_field_type(word)
        return _long(field, "struct" if is_struct else "type", word, rest) if isinstance(field.value, str) else field


def _bit_field(field: Node) -> Node:
    if not isinstance(field, Scalar) or not isinstance(field.value, str):
        return field
    word, _, rest = field.value.partition(" ")
    return _long(field, "type", word, rest)


def _long(field: Scalar, key: str, word: str, rest: str) -> Mapping:
    """Expand `i16 0.001 m/s`: one step of the number on the wire, and the unit; each may be left out."""
    values = {key: Scalar(field.place, word, word)}
    first, _, behind = rest.strip().partition(" ")
    if isinstance(step := value_of(first), Number):
        values["scale"] = Scalar(field.place, first, step)
        rest = behind
    if unit := rest.strip():
        values["unit"] = Scalar(field.place, unit, unit)
    return Mapping(field.place, {name: Entry(field.place, value) for name, value in values.items()})


def _services(services: Node) -> Node:
    for name in ONE_MESSAGE:
        services = _under(name, _service)(services)
    return services


def _service(service: Node) -> Node:
    if not isinstance(service, Scalar) or not isinstance(service.value, str):
        return service
    return Mapping(service.place, {"message": Entry(service.place, service)})


def _each(change: _Change) -> _Change:
    """Return a function that changes every value of a mapping."""

    def changed(node: Node) -> Node:
        if not isinstance(node, Mapping):
            return node
        return Mapping(node.place, {k: Entry(e.key_place, change(e.value)) for k, e in node.entries.items()})

    return changed


def _under(key: str, change: _Change) -> _Change:
    """Return a function that changes the value of this key, if it exists."""

    def changed(node: Node) -> Node:
        if not isinstance(node, Mapping) or key not in node.entries:
            return node
        entry = node.entries[key]
        return Mapping(node.place, {**node.entries, key: Entry(entry.key_place, change(entry.value))})

    return changed
