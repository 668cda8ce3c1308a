"""The syntax of what encloses a frame: delimiters, stuffing and silence, around the parts of `frame_grammar`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, TypeAlias

from pydantic import AfterValidator, Field

from wirebond.protocol.plan import MAX_INSERTION
from wirebond.protocol.text.frame_grammar import INNER, MAX_PARTS, InnerPart, InnerParts, union_of
from wirebond.protocol.text.scalars import ConstantBytes, DelimiterBytes, Duration, OneByte, one_word, wrong
from wirebond.protocol.text.wording import Syntax


class DelimiterPart(Syntax):
    """The byte, or the two, before and after every frame."""

    noun = "a `delimiter` part"
    delimiter: DelimiterBytes = Field(
        description="The byte, or the two bytes, before and after every frame; first and last part.",
        examples=["0x00"],
    )


class CobsPart(Syntax):
    """Parts that are stuffed with COBS."""

    noun = "a `cobs` part"
    cobs: list[InnerPart] = Field(
        min_length=1,
        max_length=MAX_PARTS,
        description="The parts between the delimiters, stuffed with COBS so that they cannot contain one.",
        examples=["[id: u8, payload: rest, check: crc-16/ibm-sdlc]"],
    )


class SlipPart(Syntax):
    """Parts that are stuffed as SLIP does (RFC 1055)."""

    noun = "a `slip` part"
    slip: InnerParts = Field(
        description="The parts between the delimiters 0xC0, stuffed as SLIP does.",
        examples=["[id: u8, payload: rest, check: crc-16/ibm-sdlc]"],
    )


class HdlcPart(Syntax):
    """Parts that are stuffed as HDLC does on asynchronous lines (RFC 1662)."""

    noun = "an `hdlc` part"
    hdlc: InnerParts = Field(
        description="The parts between the delimiters 0x7E, stuffed as HDLC does: 0x7D, then the byte xor 0x20.",
        examples=["[id: u8, payload: rest, check: crc-16/ibm-sdlc]"],
    )


class DoubledPart(Syntax):
    """Parts in which the delimiters' first byte is doubled."""

    noun = "a `doubled` part"
    doubled: InnerParts = Field(
        description="The parts between delimiters that begin alike (DLE STX, DLE ETX; or DLE alone, DLE ETX): this "
        "first byte is sent twice wherever it occurs in them.",
        examples=["[id: u8, payload: rest, check: crc-16/ibm-sdlc]"],
    )


class Escaped(Syntax):
    """An escape rule of one's own."""

    noun = "`escaped`"

    escape: OneByte = Field(description="The byte that announces a stuffed one.", examples=["0x10"])
    xor: OneByte = Field(description="A stuffed byte is sent xor this.", examples=["0x20"])
    also: ConstantBytes | None = Field(
        None, description="Bytes to stuff beside the delimiters and the escape.", examples=["0x11 0x13"]
    )
    parts: InnerParts = Field(
        description="The parts that are stuffed.", examples=["[id: u8, payload: rest, check: sum8]"]
    )


class EscapedPart(Syntax):
    """Parts that are stuffed by an escape rule of one's own."""

    noun = "an `escaped` part"
    escaped: Escaped = Field(description="Escape rule of one's own, and the parts that it covers.")


def _sequence(after: bytes) -> bytes:
    if not 2 <= len(after) <= MAX_INSERTION:
        raise wrong(f"the sequence has {len(after)} bytes; write 2 to {MAX_INSERTION}, such as 0xFF 0xFF 0xFD")
    if any(after[:size] == after[-size:] for size in range(1, len(after))):
        raise wrong("this sequence ends as it begins, so two of them could overlap; choose another")
    return after


class HexPart(Syntax):
    """Parts that are sent as hex digits."""

    noun = "a `hex` part"
    hex: InnerParts = Field(
        description="The parts between the delimiters, each byte sent as two hex digits, the high one first.",
        examples=["[id: u8, payload: rest, check: sum8-negated]"],
    )
    first: Annotated[str | None, one_word("digit")] = Field(
        None, description="The first byte is below 16, and sent as one digit.", examples=["digit"]
    )


class Inserted(Syntax):
    """A byte that is inserted after a sequence."""

    noun = "`inserted`"

    after: Annotated[ConstantBytes, AfterValidator(_sequence)] = Field(
        description="Two to four bytes; the first differs from the last.", examples=["0xFF 0xFF 0xFD"]
    )
    byte: OneByte = Field(description="The byte that is sent after them, wherever they occur.", examples=["0xFD"])
    parts: InnerParts = Field(description="The parts that are stuffed.", examples=["[id: u8, payload: by_length]"])


class InsertedPart(Syntax):
    """Parts in which a byte is inserted after a sequence."""

    noun = "an `inserted` part"
    inserted: Inserted = Field(description="The sequence, the byte after it, and the parts that it covers.")


class SilencePart(Syntax):
    """The pause that ends a frame."""

    noun = "a `silence` part"
    silence: Duration = Field(
        description="Last part: a frame ends when the line is silent for so long.", examples=["2 ms"]
    )


_OUTER: dict[str, type[Syntax]] = {
    "delimiter": DelimiterPart,
    "slip": SlipPart,
    "hdlc": HdlcPart,
    "doubled": DoubledPart,
    "escaped": EscapedPart,
    "hex": HexPart,
    "inserted": InsertedPart,
    "silence": SilencePart,
    "cobs": CobsPart,
}

if TYPE_CHECKING:
    Part: TypeAlias = Syntax
else:
    Part = union_of({**INNER, **_OUTER})
