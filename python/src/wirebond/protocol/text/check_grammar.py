"""The syntax of a check: what it is, what it covers, and how it is sent."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from wirebond.protocol.algorithms import OWN_KINDS
from wirebond.protocol.text.frame_scalars import ByteRanges, CheckName, PartRanges
from wirebond.protocol.text.scalars import Bool, CheckWidth, Modulus, Register, WordSize, one_word
from wirebond.protocol.text.wording import Syntax


class Avoided(Syntax):
    """Values that a check must not have on the wire, such as those of control characters."""

    noun = "`avoid`"

    values: ByteRanges = Field(description="One value, a range, or a list of these.", examples=["[0x0A, 0x0D]"])
    plus: Register = Field(description="Added to such a value, once.", examples=[1])


class Check(Syntax):
    """A check, in full. A kind, such as `type: sum`, with a `width` gives one of one's own.

    Its value is worked out in this order: the sum over the units, `odd`, `negate`, `plus`, `mask`, `xorout`, `bcd`,
    `avoid`.
    """

    noun = "`check`"

    type: CheckName = Field(
        description=f"Name in the catalogue of check algorithms, or for one's own its kind: {', '.join(OWN_KINDS)}.",
        examples=["crc-16/ibm-sdlc"],
    )
    over: PartRanges | None = Field(
        None,
        description="The parts it covers, first..last by kind or name, or a list of such ranges in the order in which "
        "they are counted; default: all that precede it.",
        examples=["id..payload"],
    )
    byte: Annotated[str | None, one_word("low", "high")] = Field(
        None, description="Send this byte of the check's value alone.", examples=["high"]
    )
    byte_order: Annotated[str | None, one_word("little", "big")] = Field(
        None, description="Byte order of the check. Default: the file's.", examples=["big"]
    )
    text: Annotated[str | None, one_word("hex", "decimal")] = Field(
        None,
        description="Sent as hex digits, two a byte, the highest first; or in decimal digits without leading zeros, at "
        "the frame's end.",
        examples=["hex"],
    )
    seed: Annotated[str | None, one_word("message")] = Field(
        None,
        description="Each message's `seed` is included after the range, and is not sent.",
        examples=["message"],
    )
    width: CheckWidth | None = Field(None, description="Bits of one's own check.", examples=[16])
    poly: Register | None = Field(
        None, description="Polynomial, highest power first, without the leading one.", examples=["0x1021"]
    )
    init: Register | None = Field(None, description="Register at the start. Default: 0.", examples=["0xFFFF"])
    refin: Bool | None = Field(None, description="Bytes enter lowest bit first. Default: false.", examples=["true"])
    refout: Bool | None = Field(None, description="The result is reflected. Default: false.", examples=["true"])
    unit: WordSize | None = Field(None, description="Bytes of the words that it runs over. Default: 1.", examples=[2])
    unit_order: Annotated[str | None, one_word("little", "big")] = Field(
        None, description="Byte order of the words. Default: the check's own.", examples=["big"]
    )
    odd: Annotated[str | None, one_word("pad", "xor", "refuse")] = Field(
        None,
        description="Bytes after the last whole word: pad them with zeros (the default), combine each by "
        "exclusive-or, or refuse the frame.",
        examples=["xor"],
    )
    carry: Annotated[str | None, one_word("drop", "end_around")] = Field(
        None,
        description="A carry out of the highest bit of a sum: drop it (the default), or add it at the lowest bit.",
        examples=["end_around"],
    )
    modulo: Modulus | None = Field(
        None,
        description="A sum, or both of Fletcher's sums, modulo this. Default: 2 to the power of its width.",
        examples=[255],
    )
    negate: Bool | None = Field(None, description="The two's complement is sent. Default: false.", examples=["true"])
    plus: Register | None = Field(None, description="Added to the value. Default: 0.", examples=[1])
    sums_to: Register | None = Field(None, description="The sum and its check add up to this.", examples=["0x55"])
    mask: Register | None = Field(None, description="Bits of the value that are sent. Default: all.", examples=["0x7F"])
    xorout: Register | None = Field(
        None, description="Combined with the result by exclusive-or. Default: 0.", examples=["0xFFFF"]
    )
    bcd: Bool | None = Field(
        None,
        description="A sum in decimal digits of four bits each; digits that have no room are dropped. Default: false.",
        examples=["true"],
    )
    avoid: Avoided | None = Field(
        None,
        description="Values that are never sent, and the number that is added if the calculation gives one of them.",
        examples=["{values: 0..0x1F, plus: 0x20}"],
    )
