"""Values that share a number's bits, as the file lists them; some of their bits may be apart from the others."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

from wirebond.protocol import names
from wirebond.protocol.meaning.fields import read_bit_field
from wirebond.protocol.model import BitOrder, Field, FieldKind
from wirebond.protocol.model.layout import members_of
from wirebond.protocol.problems import Problems, suggestion
from wirebond.protocol.text.field_grammar import BitFieldSyntax
from wirebond.protocol.text.syntax import readable
from wirebond.protocol.text.yaml_tree import Mapping


class BitMembers:
    """Reads the entries below ``fields`` of a number's bits."""

    def __init__(self, node: Mapping, problems: Problems) -> None:
        self._node = node
        self._problems = problems
        self._continued: dict[str, int] = defaultdict(int)  # bits of each value that are elsewhere

    def read(self) -> list[Field]:
        """Read the correct ones; faults of others have been reported. A continuation of another one is padding."""
        syntaxes: dict[str, BitFieldSyntax] = {}
        for name, entry in self._node.entries.items():
            syntax = readable(BitFieldSyntax, entry.value) if not names.fault(name) else None
            if syntax is not None and isinstance(entry.value, Mapping):
                syntaxes[name] = syntax
        for name, syntax in syntaxes.items():
            if syntax.continues is not None and self._can_continue(name, syntaxes):
                self._continued[syntax.continues] += syntax.type.width
        return [one for name, syntax in syntaxes.items() if (one := self._member(name, syntax)) is not None]

    def _member(self, name: str, syntax: BitFieldSyntax) -> Field | None:
        node = self._node.entries[name].value
        assert isinstance(node, Mapping)
        if syntax.continues is None:
            return read_bit_field(name, syntax, node, self._problems, self._continued[name])
        if syntax.continues not in self._continued:
            return None
        foreign = next((key for key in node.entries if key not in ("type", "continues", "description")), None)
        if foreign is not None:
            self._problems.add(
                node.key_place(foreign), f"these are bits of `{syntax.continues}`; write `{foreign}` there"
            )
            return None
        described = syntax.description or f"more bits of `{syntax.continues}`"
        return Field(name, FieldKind.PADDING, 0, bits=syntax.type.width, description=described)

    def _can_continue(self, name: str, syntaxes: dict[str, BitFieldSyntax]) -> bool:
        syntax, node = syntaxes[name], self._node.entries[name].value
        assert isinstance(node, Mapping)
        earlier = [one for one in syntaxes if syntaxes[one].continues is None]
        earlier = earlier[: sum(one in earlier for one in list(syntaxes)[: list(syntaxes).index(name)])]
        base = syntax.continues
        if base not in earlier:
            known = suggestion(base or "", earlier) if earlier else "the value comes first"
            self._problems.add(node.value_place("continues"), f"no value before this one is called `{base}`; {known}")
            return False
        mine, its = syntax.type, syntaxes[base].type
        if (mine.kind, mine.coding) != (its.kind, its.coding):
            letter = its.word.rstrip("0123456789")
            self._problems.add(
                node.value_place("type"), f"`{base}` is `{its.word}`; write `{letter}{mine.width}` here, too"
            )
            return False
        return True


def with_pieces(container: Field, node: Mapping) -> Field:
    """Return the number with the places of all pieces of its values."""
    found: dict[str, list[tuple[int, int]]] = defaultdict(list)
    for member in members_of(container):
        name = member.field.name
        syntax = readable(BitFieldSyntax, node.entries[name].value)
        base = syntax.continues if syntax is not None and syntax.continues is not None else name
        found[base].append((member.low, member.field.bits_here))
    step = -1 if container.first == BitOrder.HIGH else 1
    fields = (
        replace(member, split=tuple(found[member.name][::step])) if member.own_bits else member
        for member in container.fields
    )
    return replace(container, fields=tuple(fields))
