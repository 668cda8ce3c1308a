"""The syntax of the `frame` section: which parts there are, and which options each takes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

from pydantic import BeforeValidator, Discriminator, Field, PlainValidator, Tag
from pydantic_core import PydanticCustomError

from wirebond.protocol.problems import quoted, suggestion
from wirebond.protocol.scalars import (
    Bool,
    CheckName,
    ConstantBytes,
    LengthOffset,
    MagicBytes,
    Name,
    OneByte,
    PartRange,
    PartType,
    Register,
    ReservedBytes,
    describe,
    one_of_numbers,
    one_word,
    whole,
    wrong,
)
from wirebond.protocol.wording import Syntax

MAX_PARTS = 32
_TAG = "part:"  # begins the union tags that pydantic puts into error locations; no key of a file looks so


def _type_alone(value: object) -> object:
    """`length: u8` is short for `length: {type: u8}`."""
    return value if isinstance(value, dict) else {"type": value}


class Length(Syntax):
    """A length number, in full."""

    noun = "`length`"

    type: PartType = Field(description="Width, and byte order where `le` or `be` follows.", examples=["u8"])
    counts: Annotated[str, one_word("payload", "rest", "self_and_rest", "frame")] = Field(
        "payload",
        description="What it counts: the payload, all that follows it, itself and all that follows, "
        "the whole frame.",
        examples=["payload"],
    )
    offset: LengthOffset = Field(0, description="Added to what it counts, in bytes.", examples=[0])


class Check(Syntax):
    """A check, in full. `type: crc` with `width` and `poly` gives a CRC of one's own."""

    noun = "`check`"

    type: CheckName = Field(
        description="Name in the catalogue of CRC algorithms, xor8, sum8, sum16, sum32, or crc for "
        "one's own.",
        examples=["crc-16/ibm-sdlc"],
    )
    over: PartRange | None = Field(
        None,
        description="The parts it covers, first..last by kind or name; all that precede it unless said.",
        examples=["id..payload"],
    )
    byte: Annotated[str | None, one_word("low", "high")] = Field(
        None, description="Send this byte of the check's value alone.", examples=["high"]
    )
    byte_order: Annotated[str | None, one_word("little", "big")] = Field(
        None, description="Byte order of the check; the file's unless said.", examples=["big"]
    )
    width: Annotated[
        int | None,
        PlainValidator(one_of_numbers(8, 16, 24, 32, 64), json_schema_input_type=Literal[8, 16, 24, 32, 64]),
    ] = Field(None, description="Bits of one's own CRC.", examples=[16])
    poly: Register | None = Field(
        None, description="Polynomial, highest power first, without the leading one.", examples=["0x1021"]
    )
    init: Register | None = Field(
        None, description="Register at the start; 0 unless said.", examples=["0xFFFF"]
    )
    refin: Bool | None = Field(
        None, description="Bytes enter lowest bit first; false unless said.", examples=["true"]
    )
    refout: Bool | None = Field(
        None, description="The result is reflected; false unless said.", examples=["true"]
    )
    xorout: Register | None = Field(
        None, description="Combined with the result; 0 unless said.", examples=["0xFFFF"]
    )


def _payload(value: object) -> int | str:
    rules = ("by_length", "by_id", "rest")
    if isinstance(value, str):
        if value in rules:
            return value
        raise wrong(
            f"{quoted(value)} does not say a payload's size; {suggestion(value, rules)}, or a number of bytes"
        )
    try:
        return whole(0, 0xFFFF)(value)
    except PydanticCustomError:
        raise wrong(
            f"{describe(value)} does not say a payload's size; write by_length, by_id, rest, or a "
            "number of bytes up to 65535"
        ) from None


class PartSyntax(Syntax):
    """One part of a frame: exactly one key that says which, and options."""

    name: Name | None = Field(
        None,
        description="A name for this part, for `over:` and for messages of tools.",
        examples=["header_check"],
    )

    @classmethod
    def known_keys(cls) -> list[str]:
        return [*(key for key in cls.model_fields if key != "name"), "name"]


class MagicPart(PartSyntax):
    """Bytes that begin every frame."""

    noun = "a `magic` part"
    magic: MagicBytes = Field(description="1 to 4 bytes that begin every frame.", examples=["0xAA 0x55"])


class ConstantPart(PartSyntax):
    """Bytes that are always the same, anywhere."""

    noun = "a `constant` part"
    constant: ConstantBytes = Field(description="Bytes that are always the same.", examples=["0x01"])


class TailPart(PartSyntax):
    """Bytes that end every frame."""

    noun = "a `tail` part"
    tail: MagicBytes = Field(description="1 to 4 bytes that end every frame.", examples=["0x0D"])


class DelimiterPart(Syntax):
    """The byte before and after every frame."""

    noun = "a `delimiter` part"
    delimiter: OneByte = Field(
        description="The byte that stands before and after every frame; first and last part.",
        examples=["0x00"],
    )


class LengthPart(PartSyntax):
    """A number that tells the payload's size."""

    noun = "a `length` part"
    length: Annotated[Length, BeforeValidator(_type_alone, json_schema_input_type=PartType | Length)] = Field(
        description="A number that tells the payload's size.", examples=["u8"]
    )


class IdPart(PartSyntax):
    """The message's id."""

    noun = "an `id` part"
    id: PartType = Field(description="The message's id.", examples=["u8"])


class PayloadPart(PartSyntax):
    """Where the message's fields stand, and how the payload's size is known."""

    noun = "a `payload` part"
    payload: Annotated[
        int | str,
        PlainValidator(
            _payload,
            json_schema_input_type=Literal["by_length", "by_id", "rest"]
            | Annotated[int, Field(ge=0, le=0xFFFF)],
        ),
    ] = Field(
        description="The payload's size: a number of bytes (shorter messages are padded with "
        "zeros), by_length, by_id "
        "(each message's own size), or rest (what lies between the delimiters).",
        examples=["by_length"],
    )


class ReservedPart(PartSyntax):
    """Bytes without meaning."""

    noun = "a `reserved` part"
    reserved: ReservedBytes = Field(
        description="Number of bytes that are sent as 0 and ignored on receive.", examples=[2]
    )


class CheckPart(PartSyntax):
    """A check over other parts."""

    noun = "a `check` part"
    check: Annotated[Check, BeforeValidator(_type_alone, json_schema_input_type=CheckName | Check)] = Field(
        description="A check over other parts, by name or in full.", examples=["crc-16/ibm-sdlc"]
    )


_INNER = ("magic", "constant", "tail", "length", "id", "payload", "reserved", "check")
_OUTER = (*_INNER, "delimiter", "cobs")


def _part_key(value: object) -> str:
    return next((_TAG + key for key in value if key in _OUTER), "") if isinstance(value, dict) else ""


def _one_part(allowed: tuple[str, ...]) -> Callable[[object], object]:
    def check(value: object) -> object:
        if not isinstance(value, dict):
            raise wrong(
                f"{describe(value)} is not a part of a frame; write `- part: value`, such as `- magic: 0xAA`"
            )
        found = [key for key in value if key in _OUTER]
        if len(found) == 1 and found[0] in allowed:
            return value
        if len(found) == 1:
            raise wrong(f"`{found[0]}` cannot stand within `cobs`; possible: {', '.join(allowed)}")
        if found:
            both = " and ".join(f"`{key}`" for key in found)
            raise wrong(f"{both} are {len(found)} parts in one entry; begin each with a `- ` of its own")
        key = next(iter(value), "")
        raise wrong(f"{quoted(str(key))} is not a part of a frame; {suggestion(str(key), allowed)}")

    return check


InnerPart = Annotated[
    Annotated[MagicPart, Tag("part:magic")]
    | Annotated[ConstantPart, Tag("part:constant")]
    | Annotated[TailPart, Tag("part:tail")]
    | Annotated[LengthPart, Tag("part:length")]
    | Annotated[IdPart, Tag("part:id")]
    | Annotated[PayloadPart, Tag("part:payload")]
    | Annotated[ReservedPart, Tag("part:reserved")]
    | Annotated[CheckPart, Tag("part:check")],
    Discriminator(_part_key),
    BeforeValidator(_one_part(_INNER)),
]


class CobsPart(Syntax):
    """Parts that are stuffed with COBS."""

    noun = "a `cobs` part"
    cobs: list[InnerPart] = Field(
        min_length=1,
        max_length=MAX_PARTS,
        description="The parts between the delimiters, stuffed with COBS so that they cannot contain one.",
        examples=["[id: u8, payload: rest, check: crc-16/ibm-sdlc]"],
    )


Part = Annotated[
    Annotated[MagicPart, Tag("part:magic")]
    | Annotated[ConstantPart, Tag("part:constant")]
    | Annotated[TailPart, Tag("part:tail")]
    | Annotated[DelimiterPart, Tag("part:delimiter")]
    | Annotated[LengthPart, Tag("part:length")]
    | Annotated[IdPart, Tag("part:id")]
    | Annotated[PayloadPart, Tag("part:payload")]
    | Annotated[ReservedPart, Tag("part:reserved")]
    | Annotated[CheckPart, Tag("part:check")]
    | Annotated[CobsPart, Tag("part:cobs")],
    Discriminator(_part_key),
    BeforeValidator(_one_part(_OUTER)),
]
