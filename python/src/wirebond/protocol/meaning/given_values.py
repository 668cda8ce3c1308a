"""The values that the file gives a message: those of an example, of the emergency stop, of `recover_by`."""

from __future__ import annotations

import re
from collections.abc import Mapping as Mapping_
from dataclasses import dataclass
from fractions import Fraction

from wirebond.protocol.meaning.field_values import fit_bytes, fit_element, settled
from wirebond.protocol.model import Field, GivenValue
from wirebond.protocol.problems import Place, Problems, suggestion
from wirebond.protocol.text.yaml_tree import Mapping, Node, Sequence

_HEX = re.compile(r"( *(0x)?[0-9a-fA-F]{2})* *")
_RESERVED = ("message", "fields", "header")


@dataclass(frozen=True)
class ValueReader:
    """Reads the values of one message and reports at their places what is wrong.

    :ivar what: who gives them, for sentences: "the example".
    :ivar beside: whether the message's values are beside its name, so that some names need `fields`.
    """

    what: str
    problems: Problems
    beside: bool = False

    def message(
        self,
        owner: str,
        fields: tuple[Field, ...],
        given: Mapping_[str, object],
        places: Mapping_[str, Node],
        at: Place,
    ) -> dict[str, GivenValue] | None:
        """Return the values of a message's fields; None after reporting what is wrong.

        :param places: the mapping in which each name of ``given`` is.
        :param at: of the whole message.
        """
        known = {field.name: field for field in fields if field.has_value}
        missing = [name for name in known if name not in given and name not in settled(fields)]
        if missing:
            self._report_missing(owner, missing, known[missing[0]], at)
        values: dict[str, GivenValue] = {}
        wrong = bool(missing)
        for name, wanted in given.items():
            inner = places[name]
            assert isinstance(inner, Mapping), "fields were given"
            if name not in known:
                there = suggestion(name, known) if known else "it has no fields at all"
                self.problems.add(inner.key_place(name), f"`{owner}` has no field `{name}`; {there}")
                wrong = True
                continue
            value = self._value(known[name], wanted, inner.get(name), inner.value_place(name))
            if value is None:
                wrong = True
            else:
                values[name] = value
        if wrong:
            return None
        fault = _counted_wrong(owner, fields, values)
        if fault:
            self.problems.add(at, fault)
        return None if fault else values

    def _report_missing(self, owner: str, missing: list[str], first: Field, at: Place) -> None:
        example = f"{first.name}: {_example(first)}"
        if self.beside and first.name in _RESERVED:
            example = f"fields: {{{example}}}"
        names = ", ".join(f"`{name}`" for name in missing)
        self.problems.add(at, f"{self.what} leaves {names} of `{owner}` open; add for example `{example}`")

    def _value(self, field: Field, wanted: object, node: Node | None, place: Place) -> GivenValue | None:
        """Return the value as ``encode`` takes it; None after reporting what is wrong."""
        if field.count is None and not field.is_list:
            return self._element(field, wanted, node, place)
        most = field.count or field.max_count
        amount = f"at most {most}" if field.is_list else str(most)
        if not isinstance(wanted, list) or not isinstance(node, Sequence):
            self.problems.add(place, f"`{field.name}` has {amount} elements; write a list, such as {_example(field)}")
            return None
        if len(wanted) > most or (len(wanted) < most and not field.is_list):
            self.problems.add(place, f"{len(wanted)} elements do not fit `{field.name}`; it has {amount}")
            return None
        elements = [self._element(field, item, one, one.place) for item, one in zip(wanted, node.items, strict=True)]
        good = tuple(element for element in elements if element is not None)
        return good if len(good) == len(elements) else None

    def _element(self, field: Field, wanted: object, node: Node | None, place: Place) -> GivenValue | None:
        if field.fields:
            if isinstance(wanted, dict) and isinstance(node, Mapping):
                return ValueReader(self.what, self.problems).message(
                    field.name, field.fields, wanted, dict.fromkeys(wanted, node), place
                )
            names = ", ".join(inner.name for inner in field.fields if inner.has_value)
            self.problems.add(place, f"`{field.name}` has fields; write a mapping of {names}")
            return None
        value, fault = _fitted(field, wanted)
        if value is None:
            self.problems.add(place, fault)
        return value


def _fitted(field: Field, wanted: object) -> tuple[GivenValue | None, str]:
    if field.value_type is bytes:
        if not isinstance(wanted, str) or not _HEX.fullmatch(wanted):
            return None, f'`{field.name}` is a byte string; write two hex digits a byte in quotes: "01 FF"'
        return fit_bytes(field, bytes.fromhex(wanted.replace("0x", " ")))
    if isinstance(wanted, dict):
        return None, f"`{field.name}` is one value; write it without {{ and }}"
    if isinstance(wanted, list) and any(isinstance(item, list | dict) for item in wanted):
        return None, f"`{field.name}` is one value; write it without [ and ]"
    assert isinstance(wanted, Fraction | bool | str | list), "the grammar gives no others"
    value, fault = fit_element(field, wanted)
    assert not isinstance(value, tuple), "it is one element"
    if isinstance(value, int) and field.flags:
        return tuple(name for name, bit in field.flags if value >> bit & 1), ""
    by_number = {number: name for name, number in reversed(field.enum)}
    return (by_number.get(value, value) if isinstance(value, int) else value), fault


def _example(field: Field) -> str:
    """Return a value that would do, for advice: zeros as far as possible."""
    if field.count is None and not field.is_list:
        return _one(field)
    count = field.count or 1
    return f"[{', '.join([_one(field)] * min(count, 2))}{', …' if count > 2 else ''}]"


def _one(field: Field) -> str:
    if field.fields:
        inner = [one for one in field.fields if one.name not in settled(field.fields)] or [
            one for one in field.fields if one.has_value and not one.is_count
        ]
        return "{" + ", ".join(f"{one.name}: {_example(one)}" for one in inner) + "}"
    if field.enum:
        return field.enum[0][0]
    zeros: dict[type | None, str] = {bool: "false", str: '""', bytes: '""'}
    return zeros.get(field.value_type, "0")


def _counted_wrong(owner: str, fields: tuple[Field, ...], values: Mapping_[str, GivenValue]) -> str:
    """Return the fault between counting fields and the fields that they count; empty: none."""
    told: dict[str, tuple[int, str]] = {}
    for field in fields:
        for counter, step in field.counters:
            number = step * _size(values.get(field.name, field.default))
            first, by = told.setdefault(counter, (number, field.name))
            if first != number:
                return (
                    f"`{counter}` of `{owner}` counts `{by}` and `{field.name}`; give both the same number of elements"
                )
    for counter, (number, by) in told.items():
        name, _, run = counter.partition(".")
        value = values.get(name)
        if run:
            value = value.get(run) if isinstance(value, Mapping_) else None
        if value is not None and value != number:
            return f"`{counter}` of `{owner}` counts `{by}`, so it is {number}; leave it out, or write {number}"
    return ""


def _size(value: GivenValue | None) -> int:
    if isinstance(value, str):
        return len(value.encode())
    return len(value) if isinstance(value, bytes | tuple) else 0
