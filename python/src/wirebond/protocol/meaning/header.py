"""Header fields: from the syntax of a `field`, a `sequence` or a run of bits to what its number means."""

from __future__ import annotations

from collections.abc import Mapping as Mapping_
from fractions import Fraction

from wirebond.protocol.meaning.field_values import Given, fit_value, number_text
from wirebond.protocol.meaning.fields import ValueReader
from wirebond.protocol.model import Address, ByteOrder, End, Field, FieldKind, HeaderDefault, HeaderField, Part
from wirebond.protocol.model.forms import header_fields, magics
from wirebond.protocol.problems import Place, Problems, suggestion
from wirebond.protocol.text.field_types import wire_type
from wirebond.protocol.text.frame_grammar import BitRun, FieldPart, HeaderSyntax
from wirebond.protocol.text.scalars import EndDefaults, WireType
from wirebond.protocol.text.yaml_tree import Mapping

_Read = tuple[HeaderField, bool]


def read_header_part(name: str, syntax: FieldPart, node: Mapping, order: ByteOrder, problems: Problems) -> _Read:
    """Read a `field` part, and return whether it is correct. Faults are reported; the result is a field in any case, so
    that references to it can be read.
    """
    return _HeaderReader(syntax, syntax.type, node, problems).read(name, syntax.type.order or order)


def read_header_run(name: str, syntax: BitRun, node: Mapping, problems: Problems) -> _Read:
    """Read a run of bits, as `read_header_part`."""
    return _HeaderReader(syntax, run_type(syntax), node, problems).read(name, None)


def run_type(syntax: BitRun) -> WireType:
    return syntax.type or wire_type(f"u{syntax.bits or 1}")


def meaning_given(syntax: HeaderSyntax) -> list[str]:
    """Return the options that only a header field has."""
    options = ("scale", "offset", "unit", "range", "enum", "flags", "default", "address", "broadcast")
    return [option for option in options if getattr(syntax, option) is not None]


def sequence_field(
    name: str, size: int, bits: int, per: str | None, order: ByteOrder = ByteOrder.LITTLE
) -> HeaderField:
    value = Field(name, FieldKind.INTEGER, size, order, bits=bits)
    return HeaderField(value, is_sequence=True, per_message=per == "message")


def read_header_values(
    given: Mapping_[str, object], parts: tuple[Part, ...], node: Mapping, problems: Problems
) -> dict[str, HeaderDefault] | None:
    """Read values of header fields from `header` of ``node``, as ``encode`` takes them; None after reporting a
    fault."""
    known = {field.name: field.value for field in header_fields(parts)}
    places = node.get("header")
    found: dict[str, HeaderDefault] = {}
    for name, wanted in given.items():
        assert isinstance(places, Mapping), "header fields were given"
        if name not in known:
            there = suggestion(name, known) if known else "it has no named fields"
            problems.add(places.key_place(name), f"the frame's header has no field `{name}`; {there}")
        elif isinstance(wanted, dict):
            problems.add(places.value_place(name), f"`{name}` is one value; write it without {{ and }}")
        else:
            assert isinstance(wanted, Fraction | bool | str | list), "the grammar gives no others"
            value, fault = fit_value(known[name], wanted)
            if fault:
                problems.add(places.value_place(name), fault)
            else:
                found[name] = _single(value)
    return found if len(found) == len(given) else None


def magic_field(parts: tuple[Part, ...]) -> HeaderField | None:
    """Return the magic as a header field, where frames of an end begin with one of several; its default is the first
    one."""
    of_end = {end: magics(parts, end) for end in (End.HOST, End.MCU)}
    if all(len(values) < 2 for values in of_end.values()):
        return None
    host, mcu = (int.from_bytes(values[0], "big") if values else 0 for values in of_end.values())
    size = len(next(value for values in of_end.values() for value in values))
    return HeaderField(Field("magic", FieldKind.INTEGER, size, ByteOrder.BIG), host, mcu)


class _HeaderReader(ValueReader):
    def read(self, name: str, order: ByteOrder | None) -> _Read:
        header = self._header(name, order)
        return header, self._good

    def _header(self, name: str, order: ByteOrder | None) -> HeaderField:
        assert isinstance(self._syntax, HeaderSyntax)
        self._validate_options()
        kind = self._type.kind
        if order is None:
            plain = Field(name, kind, 0, bits=self._type.width)
        else:
            plain = Field(name, kind, self._type.size, order)
        if not self._good:
            return HeaderField(plain)
        field = Field(**{**vars(plain), **self._common(name)})
        if not self._means_something(field):
            return HeaderField(plain)
        host, mcu = self._defaults(field, self._syntax.default)
        address = None if self._syntax.address is None else Address(self._syntax.address)
        broadcast = self._broadcast(field, address)
        if address == Address.MCU and host in broadcast:
            self._wrong(
                self._node.place if self._syntax.default is None else self._node.value_place("default"),
                f"the default of `{name}`, {host}, is its broadcast, and no MCU can have that address; add for example "
                f"`default: {1 if host != 1 else 2}`",
            )
        return HeaderField(field, host, mcu, address=address, broadcast=broadcast)

    def _defaults(self, field: Field, given: EndDefaults | None) -> tuple[HeaderDefault, HeaderDefault]:
        if given is None:
            return (self._zero(field),) * 2
        node = self._node.get("default")
        if isinstance(node, Mapping):
            places = node.value_place("host"), node.value_place("mcu")
        else:
            places = (self._node.value_place("default"),) * 2
        host = self._fitted(field, given.host, places[0])
        # One value for both ends is reported once.
        mcu = host if given.mcu is given.host else self._fitted(field, given.mcu, places[1])
        return host, mcu

    def _zero(self, field: Field) -> HeaderDefault:
        value, fault = fit_value(field, Fraction(0))
        if fault:
            first = field.enum[0][0] if field.enum else number_text(Fraction(field.minimum or 0))
            self._wrong(
                self._node.place,
                f"`{field.name}` cannot be 0, which is sent where the sender gives no value; add for example "
                f"`default: {first}`",
            )
        return _single(value)

    def _broadcast(self, field: Field, address: Address | None) -> tuple[HeaderDefault, ...]:
        values = getattr(self._syntax, "broadcast", None)
        if values is None:
            return ()
        if address not in (Address.MCU, Address.RECEIVER):
            self._wrong(
                self._node.key_place("broadcast"),
                "`broadcast` belongs to the address of a receiver; add `address: mcu` or `address: receiver`",
            )
        return tuple(self._fitted(field, value, self._node.value_place("broadcast")) for value in values)

    def _fitted(self, field: Field, given: Given, place: Place) -> HeaderDefault:
        value, fault = fit_value(field, given)
        if fault:
            self._wrong(place, fault)
        return _single(value)


def _single(value: object) -> HeaderDefault:
    return value if isinstance(value, (int, float, str)) else 0
