"""Lists of fields: of a message, of a struct, of a group, of a named type, and the bits of a number."""

from __future__ import annotations

from dataclasses import dataclass, field

from wirebond.protocol import names
from wirebond.protocol.meaning.bit_members import BitMembers, with_pieces
from wirebond.protocol.meaning.counts import Counting, mark_counts
from wirebond.protocol.meaning.plain_fields import read_plain
from wirebond.protocol.model import BitOrder, ByteOrder, Field, FieldKind
from wirebond.protocol.problems import Place, Problems, suggestion
from wirebond.protocol.text.field_grammar import (
    BitsFieldSyntax,
    GroupFieldSyntax,
    PlainSyntax,
    StructSyntax,
)
from wirebond.protocol.text.syntax import readable
from wirebond.protocol.text.yaml_tree import Mapping, Node, Scalar

MAX_VALUES = 1000  # of a message, those of its structs counted as often as used
MAX_DEPTH = 8

FieldList = tuple[Field, ...]


@dataclass
class Types:
    """The file's named types, each read when it is first asked for."""

    node: Node | None
    order: ByteOrder
    problems: Problems
    _found: dict[str, FieldList | None] = field(default_factory=dict)
    _open: list[str] = field(default_factory=list)

    def names(self) -> dict[str, Place]:
        """Return every type's name with its place."""
        entries = self.node.entries if isinstance(self.node, Mapping) else {}
        return {name: entry.key_place for name, entry in entries.items()}

    def read_all(self) -> None:
        """Report what is wrong with types that no message uses."""
        for name in self.names():
            self._read(name)

    def fields_of(self, name: str, place: Place) -> FieldList | None:
        """Return the type's fields; None where something is wrong, which has been reported. ``place``: of the
        reference."""
        if name in self._open:
            chain = " in ".join(f"`{step}`" for step in [name, *reversed(self._open[self._open.index(name) :])])
            self.problems.add(place, f"a type cannot contain itself ({chain}); take it out")
            return None
        if len(self._open) >= MAX_DEPTH:
            self.problems.add(place, f"types lie more than {MAX_DEPTH} deep in each other; nest them less")
            return None
        known = self.names()
        if name not in known:
            there = suggestion(name, known) if known else "write its fields here, or add it under `types:`"
            self.problems.add(place, f"there is no type `{name}`; {there}")
            return None
        return self._read(name)

    def _read(self, name: str) -> FieldList | None:
        if name not in self._found:
            assert isinstance(self.node, Mapping)
            entry = self.node.entries[name]
            self._open.append(name)
            fields, complete = read_fields(entry.value, self)
            self._open.pop()
            sound = complete and not names.fault(name) and _bounded(fields, entry.key_place, self.problems)
            self._found[name] = fields if sound else None
        return self._found[name]


def read_fields(node: Node | None, types: Types) -> tuple[FieldList, bool]:
    """Return the fields that are right, and whether these are all of them. What is wrong has been reported."""
    if node is None:
        return (), True
    if not isinstance(node, Mapping):
        return (), False
    found: dict[str, Field] = {}
    for name, entry in node.entries.items():
        if not names.fault(name) and isinstance(entry.value, Mapping):
            one = _read_field(name, entry.value, found, types)
            if one is not None:
                found[name] = one
    _validate_names(node, types.problems)
    _validate_ends(node, found, types.problems)
    fields = tuple(mark_counts(found).values())
    return fields, len(fields) == len(node.entries) and _bounded(fields, node.place, types.problems)


def _read_field(name: str, node: Mapping, earlier: dict[str, Field], types: Types) -> Field | None:
    if "bits" in node.entries:
        return _read_bits(name, node, types)
    if "struct" in node.entries:
        return _read_struct(name, node, types)
    if "group" in node.entries:
        return _read_group(name, node, earlier, types)
    syntax = readable(PlainSyntax, node)
    return None if syntax is None else read_plain(name, syntax, node, types.order, earlier, types.problems)


def _read_bits(name: str, node: Mapping, types: Types) -> Field | None:
    inner = node.get("bits")
    members = inner.get("fields") if isinstance(inner, Mapping) else None
    if not isinstance(inner, Mapping) or not isinstance(members, Mapping):
        return None
    found = BitMembers(members, types.problems).read()
    _validate_names(members, types.problems)
    syntax = readable(BitsFieldSyntax, node)
    if syntax is None or len(found) != len(members.entries):
        return None
    container = syntax.bits.type
    needed = sum(member.bits_here for member in found)
    if needed > container.width:
        types.problems.add(
            inner.value_place("type"),
            f"these fields need {needed} bits, and {container.word} has {container.width}; take a wider type",
        )
        return None
    shared = Field(
        name=name,
        kind=FieldKind.BITS,
        size=container.size,
        order=container.order or types.order,
        first=BitOrder(syntax.bits.first),
        fields=tuple(found),
        description=syntax.description,
    )
    return with_pieces(shared, members)


def _read_struct(name: str, node: Mapping, types: Types) -> Field | None:
    fields = _fields_or_type(node, "struct", types)
    syntax = readable(StructSyntax, node)
    if fields is None or syntax is None:
        return None
    type_name = syntax.struct if isinstance(syntax.struct, str) else ""
    return Field(
        name=name, kind=FieldKind.STRUCT, size=0, fields=fields, type_name=type_name, description=syntax.description
    )


def _read_group(name: str, node: Mapping, earlier: dict[str, Field], types: Types) -> Field | None:
    inner = node.get("group")
    if not isinstance(inner, Mapping):
        return None
    fields = _fields_or_type(inner, "fields", types)
    syntax = readable(GroupFieldSyntax, node)
    if fields is None or syntax is None:
        return None
    group = syntax.group
    step = 0 if any(one.is_variable for one in fields) else sum(one.min_wire_bytes for one in fields)
    amount = Counting(inner, "count", earlier, group.max, step, types.problems).read(group.count)
    if amount is None:
        return None
    if amount.fixed is not None and group.max is not None:
        types.problems.add(inner.key_place("max"), "`max` is for a number that varies; remove it, or the number")
        return None
    if any(one.reaches_end for one in fields):
        types.problems.add(
            inner.key_place("fields"),
            "an element that reaches to the payload's end leaves no room for another; give it a counted or fixed size",
        )
        return None
    return Field(
        name=name,
        kind=FieldKind.STRUCT,
        size=0,
        fields=fields,
        type_name=group.fields if isinstance(group.fields, str) else "",
        count=amount.fixed,
        max_count=group.max or 0,
        **amount.options(),
        description=syntax.description,
    )


def _fields_or_type(node: Mapping, key: str, types: Types) -> FieldList | None:
    value = node.get(key)
    if isinstance(value, Scalar):
        word = value.value
        if not isinstance(word, str) or names.fault(word):
            return None  # the grammar reports it
        return types.fields_of(word, value.place)
    fields, complete = read_fields(value, types)
    return fields if complete else None


def _validate_names(node: Mapping, problems: Problems) -> None:
    for name, other in names.meeting(name for name in node.entries if not names.fault(name)):
        problems.add(node.key_place(name), names.meeting_fault(name, other))


def _validate_ends(node: Mapping, found: dict[str, Field], problems: Problems) -> None:
    """Check that only the last field reaches to the payload's end."""
    last = next(reversed(node.entries), "")
    for name, one in found.items():
        entry = node.entries[name]
        if not one.reaches_end or name == last:
            continue
        assert isinstance(entry.value, Mapping)
        if one.digits is not None:
            problems.add(
                entry.key_place,
                f"`{name}` reaches to the payload's end, so it must be the last; move it, or give its number of "
                "characters (`size: 6`) or the byte after it (`ends_with: 0x2C`)",
            )
        elif one.is_string:
            problems.add(
                entry.value.key_place("max"),
                "a field with `max` reaches to the payload's end, so it must be the last; move it, or write `size`",
            )
        else:
            problems.add(
                entry.key_place,
                f"`{name}` reaches to the payload's end, so it must be the last; move it, or let a field count it",
            )


def _values(fields: FieldList) -> int:
    return sum(_values(one.fields) if one.fields else 1 for one in fields)


def _depth(fields: FieldList) -> int:
    return 1 + max((_depth(one.fields) for one in fields if one.fields), default=0)


def _bounded(fields: FieldList, place: Place, problems: Problems) -> bool:
    count, depth = _values(fields), _depth(fields)
    if count > MAX_VALUES:
        problems.add(place, f"these are {count} values, those of structs included; at most {MAX_VALUES}")
    elif depth > MAX_DEPTH:
        problems.add(place, f"structs lie {depth} deep here; at most {MAX_DEPTH}")
    return count <= MAX_VALUES and depth <= MAX_DEPTH
