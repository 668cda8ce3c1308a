"""Reads the number of elements or bytes of a field: a number in the file, or earlier fields that count them."""

from __future__ import annotations

from collections.abc import Mapping as AbstractMapping
from dataclasses import dataclass, replace
from typing import Any

from wirebond.protocol.model import Field, FieldKind
from wirebond.protocol.problems import Place, Problems
from wirebond.protocol.text.field_grammar import TO_END, CountSyntax
from wirebond.protocol.text.yaml_tree import Mapping

Earlier = AbstractMapping[str, Field]


@dataclass(frozen=True)
class Amount:
    """A fixed number, or the fields that give a varying one: none if it reaches to the payload's end."""

    fixed: int | None = None
    counted_by: str = ""
    counted_in_bytes: bool = False
    bytes_counted_by: str = ""
    asked_by: str = ""

    def options(self) -> dict[str, Any]:
        """Return the model's options for it, except for a fixed number."""
        return {key: value for key, value in vars(self).items() if key != "fixed"}


@dataclass(frozen=True)
class Counting:
    """One `count` or `size`: the mapping that it is in, the fields before it, and the counted field.

    ``step``: wire bytes of one element; 0 where each has its own.
    """

    node: Mapping
    key: str
    earlier: Earlier
    most: int | None
    step: int
    problems: Problems

    def read(self, amount: int | str | CountSyntax | None) -> Amount | None:
        """Read the count; None after reporting a fault."""
        place = self.node.value_place(self.key)
        if amount is None or isinstance(amount, int):
            return Amount(amount)
        if self.most is None:
            what = "bytes" if self.key == "size" else "elements"
            self.problems.add(place, f"a varying number of {what} needs a bound; add `max: 16`")
            return None
        if isinstance(amount, str):
            if amount == TO_END:
                return Amount()
            return Amount(counted_by=amount) if self._counts(amount, place, False) else None
        return self._read_mapping(amount, place)

    def _read_mapping(self, syntax: CountSyntax, place: Place) -> Amount | None:
        inner = self.node.get(self.key)
        at = inner.value_place if isinstance(inner, Mapping) else lambda _: place
        asked_by = syntax.asked_by or ""
        if syntax.elements is None and syntax.bytes is None:
            self.problems.add(
                place,
                "the number of elements is not given; write `bytes: size` (a field that gives their size in bytes), "
                "or `elements: number`",
            )
            return None
        if syntax.elements == syntax.bytes:
            self.problems.add(
                at("bytes"),
                f"`{syntax.bytes}` cannot count both elements and bytes; name another field, or keep one of the two",
            )
            return None
        if syntax.bytes is not None and self.step == 0:
            self.problems.add(
                at("bytes"),
                "each of these elements has its own size, so their number does not follow from bytes; write `count: "
                "number`, with a field that gives their number",
            )
            return None
        names = ((syntax.elements, "elements"), (syntax.bytes, "bytes"))
        good = [
            self._counts(name, at(key), key == "bytes" and self.step > 1) for name, key in names if name is not None
        ]
        if not all(good):
            return None
        if syntax.elements is None:
            in_bytes = self.step > 1  # of elements of one byte it is the same
            return Amount(counted_by=syntax.bytes or "", counted_in_bytes=in_bytes, asked_by=asked_by)
        return Amount(counted_by=syntax.elements, bytes_counted_by=syntax.bytes or "", asked_by=asked_by)

    def _counts(self, name: str, place: Place, in_bytes: bool) -> bool:
        """Return whether the field of this name can count the elements, or the bytes."""
        field = self._found(name, place)
        if field is None:
            return False
        is_plain = field.is_unsigned and field.digits is None and field.count is None and not field.is_list
        if (
            not is_plain
            or field.is_scaled
            or field.split
            or field.enum
            or field.flags
            or (field.minimum, field.default) != (None,) * 2
        ):
            self.problems.add(
                place,
                f"`{name}` cannot count, for it is more than a number; make it one unsigned whole number without other "
                "options",
            )
            return False
        for other in self.earlier.values():
            told = dict(other.counters)
            if name in told and (in_bytes or (other.is_list and name != other.counted_by) or other.counted_in_bytes):
                self.problems.add(
                    place,
                    f"`{name}` counts `{other.name}` already, and a field that counts bytes cannot count anything "
                    "else; give one of them a field of its own",
                )
                return False
        assert self.most is not None
        if self.most * (self.step if in_bytes else 1) >= 2**field.width:
            bytes_of = f", of {self.step} bytes each" if in_bytes else ""
            self.problems.add(
                place,
                f"`{name}` counts to {2**field.width - 1}, and `max` is {self.most}{bytes_of}; lower that, or take a "
                "wider type",
            )
            return False
        return True

    def _found(self, name: str, place: Place) -> Field | None:
        outer, _, run = name.partition(".")
        field = self.earlier.get(outer)
        if field is not None and field.kind == FieldKind.BITS:
            runs = {one.name: one for one in field.fields if one.has_value}
            if run in runs:
                return runs[run]
            there = " or ".join(f"`{outer}.{one}`" for one in runs)
            sentence = f"`{outer}` is shared by several values, and one of them can count; write {there}"
            if run:
                sentence = f"no value among the bits of `{outer}` is called `{run}`; write {there}"
            self.problems.add(
                place, sentence if runs else f"`{outer}` has no value that could count; name another field"
            )
            return None
        if field is not None and not run:
            return field
        possible = [path for one in self.earlier.values() for path in _paths(one)]
        there = f"possible: {', '.join([*possible, TO_END])}" if possible else "the field that counts comes first"
        self.problems.add(place, f"no earlier field beside this one is called `{name}`; {there}")
        return None


def _paths(field: Field) -> list[str]:
    if field.kind != FieldKind.BITS:
        return [field.name]
    return [f"{field.name}.{one.name}" for one in field.fields if one.has_value]


def mark_counts(fields: dict[str, Field]) -> dict[str, Field]:
    """Return the same fields, with those that count others marked."""
    counting = {name for one in fields.values() for name, _ in one.counters}
    if not counting:
        return fields
    return {name: _marked(one, name, counting) for name, one in fields.items()}


def _marked(field: Field, path: str, counting: set[str]) -> Field:
    runs = field.fields if field.kind == FieldKind.BITS else ()
    if not runs:
        return replace(field, is_count=path in counting)
    return replace(field, fields=tuple(replace(one, is_count=f"{path}.{one.name}" in counting) for one in runs))
