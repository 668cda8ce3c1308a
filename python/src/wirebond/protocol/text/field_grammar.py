"""The syntax of a message's fields, as models: single values, bit fields, structs and groups.

What keys mean together is not validated here (see ``fields`` and ``structs``).
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Discriminator, Field, PlainValidator, Tag
from pydantic_core import PydanticCustomError

from wirebond.protocol import names
from wirebond.protocol.problems import quoted
from wirebond.protocol.text.field_types import BitType, ContainerType, FieldType, TypeWord
from wirebond.protocol.text.scalars import (
    BitNumber,
    Bool,
    Count,
    DefaultValue,
    Exact,
    Name,
    OneByte,
    Text,
    WireInteger,
    describe,
    in_schema,
    one_word,
    whole,
    wrong,
)
from wirebond.protocol.text.wording import Syntax
from wirebond.protocol.text.yaml_tree import Number

TO_END = "to_end"
MAX_COUNT = 0xFFFF

_NAME = names.PATTERN.removeprefix("^").removesuffix("$")

_COUNTED = "the name of the field that gives it"
_COUNTS = (
    "`counts` is not a key of %s: the counted field names its count; write there `count: number` or `count: "
    "{bytes: number}`, or for a value among bits `count: state.number`"
)


def _amount(value: object) -> int | str:
    if isinstance(value, Number):
        return whole(1, MAX_COUNT)(value)
    if isinstance(value, str):
        return value  # which field, if any, is looked up where the fields are known
    raise wrong(f"{describe(value)} does not say how many; write a whole number, or {_COUNTED}")


# A field, or one among the bits of a field: `state.number`.
_CounterText = Annotated[str, Field(pattern=f"^{_NAME}([.]{_NAME})?$", max_length=2 * names.MAX_LENGTH + 1)]
Amount = Annotated[
    int | str,
    PlainValidator(_amount, json_schema_input_type=Annotated[int, Field(ge=1, le=MAX_COUNT)] | _CounterText),
]


def _counter(value: object) -> str:
    if isinstance(value, str):
        return value
    raise wrong(f"{describe(value)} is not a field that counts; write {_COUNTED}")


Counter = Annotated[str, PlainValidator(_counter, json_schema_input_type=_CounterText)]


class CountSyntax(Syntax):
    """The number of elements."""

    noun = "`count`"

    elements: Counter | None = Field(
        None, description="The earlier field that gives the number of elements.", examples=["number"]
    )
    bytes: Counter | None = Field(
        None, description="The earlier field that gives the size of all elements in bytes.", examples=["size"]
    )
    asked_by: Name | None = Field(
        None,
        description="In a reply: the field of the request that says how many elements it wants. `wirebond sim` "
        "answers with as many.",
        examples=["number"],
    )


def _count_kind(value: object) -> str:
    return "count:mapping" if isinstance(value, dict) else "count:plain"


ElementCount = Annotated[
    Annotated[Amount, Tag("count:plain")] | Annotated[CountSyntax, Tag("count:mapping")], Discriminator(_count_kind)
]


class NumberSyntax(Syntax):
    """The properties of every number."""

    scale: Exact | None = Field(None, description="value = number on the wire * scale + offset.", examples=[0.001])
    offset: Exact | None = Field(None, description="value = number on the wire * scale + offset.", examples=[0])
    unit: Text | None = Field(None, description="SI unit of the value, for display.", examples=["m/s"])
    range: Annotated[list[Exact], Field(min_length=2, max_length=2)] | None = Field(
        None, description="Minimum and maximum, in the value's unit.", examples=["[-1.0, 1.0]"]
    )
    enum: Annotated[dict[Name, WireInteger], Field(min_length=1)] | None = Field(
        None, description="Names of the possible numbers.", examples=["{off: 0, on: 1}"]
    )
    flags: Annotated[dict[Name, BitNumber], Field(min_length=1)] | None = Field(
        None, description="Names of bits, 0 the lowest.", examples=["{stalled: 0, overheated: 1}"]
    )
    description: Text = Field("", description="For people.", examples=["what it means"])


class ValueSyntax(NumberSyntax):
    """The properties of every kind of value in a payload."""

    on_range: Annotated[str | None, one_word("reject", "clamp")] = Field(
        None,
        description="Reaction of the receiver to a value out of range. Default: reject.",
        examples=["clamp"],
    )
    default: DefaultValue | None = Field(
        None, description="The value where a sender gives none; for an array also a list.", examples=[0]
    )
    constant: DefaultValue | None = Field(
        None,
        description="The field always has this value, and is not a value of the message: a frame that has another is "
        "not a frame.",
        examples=["0x01"],
    )
    must_be_zero: Bool | None = Field(
        None, description="Of padding: a frame in which it is not zero is not a frame.", examples=[True]
    )

    @classmethod
    def _worded(cls, kind: str, loc: tuple[int | str, ...], facts: dict[str, Any], value: Any) -> PydanticCustomError:
        if kind == "extra_forbidden" and loc[-1:] == ("counts",):
            return wrong(_COUNTS % cls.noun, "wrong_key")
        return super()._worded(kind, loc, facts, value)


class PlainSyntax(ValueSyntax):
    """A value that begins and ends with a byte, or an array of values."""

    noun = "a field"
    short = "a type, such as `u16`, or "

    type: FieldType = Field(
        description="Type on the wire; add `le` or `be` to a number's type for its byte order. u1 to u64, i2 to i64, "
        "s2 to s64 (sign and amount) and bcd4 to bcd60 (decimal digits) with `packed`, else in steps of 8 bits.",
        examples=["u16"],
    )
    count: ElementCount | None = Field(
        None,
        description="Elements of an array: a number, the earlier field that gives it, another way to know it, or "
        "to_end.",
        examples=[4],
    )
    packed: Annotated[str | None, one_word("low_first", "high_first")] = Field(
        None,
        description="Elements of any number of bits follow each other without gaps, from the lowest or the highest "
        "bit of each byte on.",
        examples=["low_first"],
    )
    size: Amount | None = Field(
        None,
        description="Bytes of a text, byte string or padding, or characters of a number: a number, or for strings the "
        "earlier field that gives it.",
        examples=[16],
    )
    max: Count | None = Field(
        None,
        description="Most bytes of a text or byte string, most characters of a number, or most elements of an array, "
        "of varying size.",
        examples=[48],
    )
    ends_with: OneByte | None = Field(
        None,
        description="For a text, byte string or number in characters of varying size: the byte that follows it and is "
        "never in it.",
        examples=["0x00"],
    )

    text: Annotated[str | None, one_word("decimal", "hex")] = Field(
        None,
        description="Of a whole number: it is sent in characters, as decimal or hex digits; `size`, `max` and "
        "`ends_with` say how many there are.",
        examples=["decimal"],
    )
    decimals: Annotated[int, PlainValidator(whole(1, 12), json_schema_input_type=int)] | None = Field(
        None, description="Of a number in decimal digits: how many of them follow the point.", examples=[2]
    )
    clock: Annotated[str | None, one_word("mcu")] = Field(
        None,
        description="The value is a time of this end's clock: when the message's values were measured. The host gives "
        "it in its own time (`message.stamp`).",
        examples=["mcu"],
    )

    @classmethod
    def known_keys(cls) -> list[str]:
        first = ("type", "count", "packed", "size", "max", "ends_with", "text", "decimals", "clock")
        return [*first, *(key for key in cls.model_fields if key not in first), "bits", "struct", "group"]

    @classmethod
    def _advice(cls, key: str) -> str:
        return super()._advice(key) if key in cls.model_fields else f"write `{key}:` and a mapping"


ShortField = (
    TypeWord
    | Annotated[
        str,
        Field(
            pattern=r"^[A-Za-z][A-Za-z0-9_]*( .*)?$",
            description="A type alone, or followed by scale and unit; or the name of one of the file's `types`.",
            examples=["u16", "u16 mV", "i16 0.001 m/s", "point"],
        ),
    ]
)


class BitFieldSyntax(ValueSyntax):
    """One of the values that share a number's bits."""

    noun = "a bit field"
    short = "a type, such as `u3`, or "

    type: BitType = Field(description="u1 to u64, i2 to i64, s2 to s64, bool (1 bit), padding.", examples=["u3"])
    size: Annotated[int, PlainValidator(whole(1, 64), json_schema_input_type=int)] | None = Field(
        None, description="Bits of padding.", examples=[2]
    )
    continues: Name | None = Field(
        None,
        description="These are more bits of the earlier value with this name: the lower ones if `first` is high, "
        "otherwise the higher ones.",
        examples=["angle"],
    )


_BitField = Annotated[BitFieldSyntax, in_schema(ShortField | BitFieldSyntax)]


class BitsSyntax(Syntax):
    """A number whose bits are shared by several values."""

    noun = "`bits`"

    type: ContainerType = Field(description="The number on the wire, unsigned.", examples=["u16"])
    first: Annotated[str, one_word("low", "high")] = Field(
        "low", description="Whether the first value has the lowest bits or the highest.", examples=["low"]
    )
    fields: Annotated[dict[Name, _BitField], Field(min_length=1)] = Field(
        description="The values; bits that are left over are sent as 0.", examples=["{mode: u3}"]
    )


class BitsFieldSyntax(Syntax):
    """Values that share a number's bits."""

    noun = "a field of bits"
    bits: BitsSyntax = Field(description="The number and the values in it.", examples=["{type: u8, fields: {}}"])
    description: Text = Field("", description="For people.", examples=["what they mean"])


class StructSyntax(Syntax):
    """Fields within a field."""

    noun = "a struct"
    struct: FieldsOrType = Field(
        description="Its fields in wire order, or the name of one of the file's `types`.",
        examples=["{x: {type: f32}, y: {type: f32}}"],
    )
    description: Text = Field("", description="For people.", examples=["what it means"])


class GroupSyntax(Syntax):
    """The number of elements of a group, and its fields."""

    noun = "`group`"

    count: ElementCount = Field(
        description="How many: a number, the earlier field that gives it, another way to know it, or to_end.",
        examples=[4],
    )
    max: Count | None = Field(None, description="Most of them where their number varies.", examples=[16])
    fields: FieldsOrType = Field(
        description="Fields of each in wire order, or the name of one of the file's `types`.",
        examples=["{x: {type: i16}, y: {type: i16}}"],
    )


class GroupFieldSyntax(Syntax):
    """Fields that repeat."""

    noun = "a group"
    group: GroupSyntax = Field(
        description="The repeated fields, and how often they repeat.", examples=["{count: 4, fields: {}}"]
    )
    description: Text = Field("", description="For people.", examples=["what they mean"])


_NESTED = ("bits", "struct", "group")
_TAG = "field:"  # begins the union tags that pydantic puts into error locations; no key of a file begins with it


def _key(value: object) -> str:
    key = next((key for key in _NESTED if key in value), "type") if isinstance(value, dict) else "type"
    return _TAG + key


def _one_kind(value: object) -> object:
    found = [key for key in ("type", *_NESTED) if key in value] if isinstance(value, dict) else []
    if len(found) > 1:
        raise wrong(f"{quoted(found[0])} and {quoted(found[1])} are two kinds of field; keep one of the two")
    return value


_LongField = (
    Annotated[PlainSyntax, Tag("field:type")]
    | Annotated[BitsFieldSyntax, Tag("field:bits")]
    | Annotated[StructSyntax, Tag("field:struct")]
    | Annotated[GroupFieldSyntax, Tag("field:group")]
)
FieldSyntax = Annotated[
    _LongField,
    Discriminator(_key),
    BeforeValidator(_one_kind, json_schema_input_type=ShortField | Annotated[_LongField, Discriminator(_key)]),
]
Fields = Annotated[dict[Name, FieldSyntax], Field(min_length=1)]


def _fields_or_type(value: object) -> str:
    return "fields:type" if isinstance(value, str) else "fields:mapping"


FieldsOrType = Annotated[
    Annotated[Name, Tag("fields:type")] | Annotated[Fields, Tag("fields:mapping")], Discriminator(_fields_or_type)
]

for _model in (StructSyntax, GroupSyntax, GroupFieldSyntax):
    _model.model_rebuild()
