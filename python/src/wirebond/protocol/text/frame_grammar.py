"""The syntax of the `frame` section: which parts there are, and which options each takes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from pydantic import BeforeValidator, Discriminator, Field, PlainValidator, Tag
from pydantic_core import PydanticCustomError

from wirebond.protocol.problems import quoted, suggestion
from wirebond.protocol.text.check_grammar import Check
from wirebond.protocol.text.conditions import When
from wirebond.protocol.text.field_grammar import NumberSyntax
from wirebond.protocol.text.field_types import ContainerType, HeaderType, RunType
from wirebond.protocol.text.frame_scalars import CheckName, MagicValue
from wirebond.protocol.text.scalars import (
    Bool,
    ConstantBytes,
    HeaderDefault,
    LengthOffset,
    MagicBytes,
    Name,
    OwnValues,
    PartType,
    Register,
    ReservedBytes,
    WordSize,
    describe,
    one_word,
    whole,
    wrong,
)
from wirebond.protocol.text.wording import Syntax
from wirebond.protocol.text.yaml_tree import Number

MAX_PARTS = 32
_TAG = "part:"  # begins the union tags that pydantic puts into error locations; no key of a file begins with it


def _type_alone(value: object) -> object:
    """Expand `length: u8` to `length: {type: u8}`."""
    return value if isinstance(value, dict) else {"type": value}


class Length(Syntax):
    """A length number, in full."""

    noun = "`length`"

    type: PartType = Field(description="Width, and byte order where `le` or `be` follows.", examples=["u8"])
    counts: Annotated[str, one_word("payload", "rest", "self_and_rest", "frame")] = Field(
        "payload",
        description="Counts the payload, everything after it, itself and everything after it, or the whole frame.",
        examples=["payload"],
    )
    offset: LengthOffset = Field(0, description="Added to the count, in bytes.", examples=[0])
    unit: WordSize = Field(
        1, description="Bytes for each unit of the count; with `counts: payload` only.", examples=[2]
    )


def _payload(value: object) -> int | str:
    rules = ("by_length", "by_id", "rest")
    if isinstance(value, str):
        if value in rules:
            return value
        raise wrong(f"{quoted(value)} does not say a payload's size; {suggestion(value, rules)}, or a number of bytes")
    try:
        return whole(0, 0xFFFF)(value)
    except PydanticCustomError:
        raise wrong(
            f"{describe(value)} does not say a payload's size; write by_length, by_id, rest, or a "
            "number of bytes up to 65535"
        ) from None


class PartSyntax(Syntax):
    """A part of a frame: exactly one key that says which, and options."""

    name: Name | None = Field(
        None,
        description="A name for this part, for `over:` and for messages of tools.",
        examples=["header_check"],
    )

    when: When | None = Field(
        None,
        description="The part is there only if this holds, of header fields, `id`, `magic`, `sender` or `size` "
        "(payload bytes).",
        examples=["flags & 0x01"],
    )

    @classmethod
    def known_keys(cls) -> list[str]:
        options = ("name", "when")
        return [*(key for key in cls.model_fields if key not in options), *options]


class MagicPart(PartSyntax):
    """Bytes that begin every frame."""

    noun = "a `magic` part"
    magic: MagicValue = Field(
        description="1 to 4 bytes that begin every frame; {any: [...]}: one of several; "
        "{host: ..., mcu: ...}: other ones for each direction.",
        examples=["0xAA 0x55"],
    )


class ConstantPart(PartSyntax):
    """Bytes that are always the same, anywhere."""

    noun = "a `constant` part"
    constant: ConstantBytes = Field(description="Bytes that are always the same.", examples=["0x01"])


class TailPart(PartSyntax):
    """Bytes that end every frame."""

    noun = "a `tail` part"
    tail: MagicBytes = Field(description="1 to 4 bytes that end every frame.", examples=["0x0D"])


class LengthPart(PartSyntax):
    """A number that gives the payload's size."""

    noun = "a `length` part"
    length: Annotated[Length, BeforeValidator(_type_alone, json_schema_input_type=PartType | Length)] = Field(
        description="A number that gives the payload's size.", examples=["u8"]
    )


class IdPart(PartSyntax):
    """The message's id."""

    noun = "an `id` part"
    id: PartType = Field(description="The message's id.", examples=["u8"])


class PayloadPart(PartSyntax):
    """The place of the message's fields, and how the payload's size is determined."""

    noun = "a `payload` part"
    trim_zeros: Bool = Field(
        False,
        description="Zeros at the payload's end are not sent, and put back by the receiver.",
        examples=["true"],
    )
    payload: Annotated[
        int | str,
        PlainValidator(
            _payload,
            json_schema_input_type=Literal["by_length", "by_id", "rest"] | Annotated[int, Field(ge=0, le=0xFFFF)],
        ),
    ] = Field(
        description="The payload's size: a number of bytes (shorter messages are padded with zeros), by_length, by_id "
        "(each message's own size), or rest (everything between the delimiters).",
        examples=["by_length"],
    )


class ReservedPart(PartSyntax):
    """Bytes without meaning."""

    noun = "a `reserved` part"
    reserved: ReservedBytes = Field(
        description="Number of bytes that are sent as 0 and ignored on receive.", examples=[2]
    )


class HeaderSyntax(NumberSyntax):
    """The properties of a number of the header."""

    default: HeaderDefault | None = Field(
        None,
        description="The value if the sender gives none; {host: ..., mcu: ...}: one for each end. Default: 0.",
        examples=[1],
    )
    address: Annotated[str | None, one_word("mcu", "receiver", "sender")] = Field(
        None,
        description="Whose address it is: the MCU's in both directions, that of the end that the frame is for, or that "
        "of the end that sends it.",
        examples=["mcu"],
    )
    broadcast: OwnValues | None = Field(
        None, description="The address, or a list of them, that means every receiver.", examples=["0xFE"]
    )


class FieldPart(PartSyntax, HeaderSyntax):
    """A named number of the header."""

    noun = "a `field` part"
    field: Name = Field(description="Name of a number in the header.", examples=["system_id"])
    type: HeaderType = Field(
        description="Type on the wire: a whole number; add `le` or `be` for the byte order.", examples=["u8"]
    )


CountedPer = Annotated[str, one_word("sender", "message")]
_PER = (
    "Counts the frames of a sender (`sender`, the default), or of each message (`message`), which then has its own "
    "numbers."
)


class SequencePart(PartSyntax):
    """A number that rises by one from frame to frame."""

    noun = "a `sequence` part"
    sequence: PartType = Field(description="Its width; it rises by one from frame to frame.", examples=["u8"])
    per: CountedPer | None = Field(None, description=_PER, examples=["message"])


_CHECK_BIT = PlainValidator(whole(0, 63), json_schema_input_type=Annotated[int, Field(ge=0, le=63)])


class BitRun(HeaderSyntax):
    """A run of bits, in full."""

    noun = "a run of bits"

    bits: (
        Annotated[int, PlainValidator(whole(1, 64), json_schema_input_type=Annotated[int, Field(ge=1, le=64)])] | None
    ) = Field(None, description="Number of bits of an unsigned number; or write `type`.", examples=[4])
    type: RunType | None = Field(
        None, description="Type of the number: u1 to u64, i2 to i64, s2 to s64; or write `bits`.", examples=["i5"]
    )
    constant: Register | None = Field(None, description="The value that it always has.", examples=["0x01"])
    per: CountedPer | None = Field(None, description=f"Of a run `sequence`. {_PER}", examples=["message"])
    check: Annotated[Check | None, BeforeValidator(_type_alone, json_schema_input_type=CheckName | Check)] = Field(
        None, description="The run is a check, or some bits of its value.", examples=["crc-4/g-704"]
    )
    from_bit: Annotated[int, _CHECK_BIT] | None = Field(
        None, description="Of a check: the bit of its value that the run's lowest bit is. Default: 0.", examples=[4]
    )


def _run(value: object) -> object:
    """Expand `length: 10` to `length: {bits: 10}`, and `turn: i5` to `turn: {type: i5}`."""
    if isinstance(value, dict) and isinstance(value.get("unit"), Number):
        raise wrong(
            "the unit of a length belongs to the whole part; write `unit` beside `fields`: `- "
            "{bits: u8, fields: {flags: 4, length: 4}, unit: 4}`"
        )
    if isinstance(value, dict) and "counts" in value:
        raise wrong(
            "`counts` belongs to the whole part; write it beside `fields`: `- "
            "{bits: u16, fields: {id: 6, length: 10}, counts: rest}`"
        )
    if isinstance(value, dict):
        return value
    return {"type" if isinstance(value, str) else "bits": value}


class BitsPart(PartSyntax):
    """Header bytes whose bits are shared."""

    noun = "a `bits` part"
    bits: ContainerType = Field(description="Width of the bytes whose bits are shared.", examples=["u16"])
    fields: dict[Name, Annotated[BitRun, BeforeValidator(_run, json_schema_input_type=int | str | BitRun)]] = Field(
        description="Name and number of bits, or type, of each run, from the lowest bit up. `id`, `length` and "
        "`sequence` have their usual meaning; `constant:` makes a run that never changes, `check:` one that is a "
        "check.",
        examples=["{id: 6, length: 10}"],
    )
    first: Annotated[str, one_word("low", "high")] = Field(
        "low", description="Whether the first run has the lowest or the highest bits.", examples=["high"]
    )
    counts: Annotated[str, one_word("payload", "rest", "self_and_rest", "frame")] = Field(
        "payload", description="The bytes that a `length` run counts.", examples=["payload"]
    )
    offset: LengthOffset = Field(0, description="Added to the count of a `length` run, in bytes.", examples=[0])
    unit: WordSize = Field(
        1, description="Bytes for each unit of a `length` run's count; with `counts: payload` only.", examples=[4]
    )


class CheckPart(PartSyntax):
    """A check over other parts."""

    noun = "a `check` part"
    check: Annotated[Check, BeforeValidator(_type_alone, json_schema_input_type=CheckName | Check)] = Field(
        description="A check over other parts, by name or in full.", examples=["crc-16/ibm-sdlc"]
    )


def part_key(value: object) -> str:
    """Return the tag of a part in the unions of parts; empty: it is none."""
    found = part_keys(value) if isinstance(value, dict) else []
    return _TAG + found[0] if found else ""


def part_keys(value: dict[str, object]) -> list[str]:
    """Return the keys that say which part this is. An option that is called as a part (`bits` within `fields`) is
    none."""
    return [key for key in value if key in INNER or key in _OUTER]


def one_part(allowed: Collection[str]) -> Callable[[object], object]:
    """Refuse values that are not one part, or not one of these."""

    def validate(value: object) -> object:
        if not isinstance(value, dict):
            raise wrong(f"{describe(value)} is not a part of a frame; write `- part: value`, such as `- magic: 0xAA`")
        found = part_keys(value)
        if len(found) == 1 and found[0] in allowed:
            return value
        if len(found) == 1:
            raise wrong(f"`{found[0]}` cannot be a stuffed part; possible: {', '.join(allowed)}")
        if found:
            both = " and ".join(f"`{key}`" for key in found)
            raise wrong(f"{both} are {len(found)} parts in one entry; begin each with a `- ` of its own")
        key = next(iter(value), "")
        raise wrong(f"{quoted(str(key))} is not a part of a frame; {suggestion(str(key), allowed)}")

    return validate


def union_of(parts: Mapping[str, type[Syntax]]) -> Any:
    """Return the type of a part that is one of these, by their keys."""
    tagged = (Annotated[part, Tag(_TAG + key)] for key, part in parts.items())
    return Annotated[reduce(or_, tagged), Discriminator(part_key), BeforeValidator(one_part(parts))]


# One entry for each part that has bytes of its own. `envelope_grammar` has those around them.
INNER: dict[str, type[PartSyntax]] = {
    "magic": MagicPart,
    "constant": ConstantPart,
    "tail": TailPart,
    "length": LengthPart,
    "id": IdPart,
    "payload": PayloadPart,
    "reserved": ReservedPart,
    "field": FieldPart,
    "sequence": SequencePart,
    "bits": BitsPart,
    "check": CheckPart,
}
_OUTER = ("delimiter", "cobs", "slip", "hdlc", "doubled", "escaped", "hex", "inserted", "silence")

if TYPE_CHECKING:
    InnerPart: TypeAlias = PartSyntax
else:
    InnerPart = union_of(INNER)

InnerParts = Annotated[list[InnerPart], Field(min_length=1, max_length=MAX_PARTS)]
