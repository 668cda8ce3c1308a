"""Frames whose parts are right one by one and do not go together; each was once read, and then failed in use."""

import pytest

from wirebond import Codec, MessageError
from wirebond.protocol import ProtocolFileError, loads

ONE = "{a: {id: 1, sender: host, fields: {x: {type: u8, default: 1}}}}"
ANY = "{a: {id: 1, sender: host, fields: {x: {type: u8, count: to_end, max: 8}}}}"
FOURTEEN = " ".join(f"0x{n:02X}" for n in range(14))


def file(parts: list[str], messages: str = ONE) -> str:
    return "\n".join(
        ["wirebond: 1", "protocol: rover", "frame:", *(f"  - {p}" for p in parts), f"messages: {messages}"]
    )


@pytest.mark.parametrize(
    ("parts", "problem"),
    [
        (
            ["magic: 0xAA", "id: u8", "length: {type: u8, unit: 4}", "payload: by_length"],
            "8:12: `a` has 1 payload bytes; the frame's length counts by 4 and cannot express this size; add "
            "`{type: padding, size: 3}`",
        ),
        (
            ["magic: 0xAA", "id: u8", "length: {type: u8, unit: 4}", "{payload: by_length, trim_zeros: true}"],
            "7:5: with `trim_zeros` a payload may end at any byte, and this length counts by 4; remove one of the two",
        ),
        (
            [
                *("magic: 0xAA", "{field: f, type: u8}", "{reserved: 4, when: f & 0x01}", "id: u8"),
                *("length: {type: u8, counts: frame, offset: -8}", "payload: by_length"),
            ],
            "8:5: with this offset a payload under 4 bytes would have a negative length; take a greater one",
        ),
        (
            [
                *("magic: 0xAA", f"constant: {FOURTEEN}"),
                *("{bits: u16, fields: {a: {bits: 12, constant: 5}, id: 4}}", "payload: by_id"),
            ],
            "4:3: the frame has 17 constant bytes, those of bits and of conditions counted; at most 16 are possible",
        ),
        (
            ["magic: 0xAA", "id: u8", "{reserved: 4, when: f & 0x01}", "{field: f, type: u8}", "payload: by_id"],
            "6:25: `f` must be in the header, before the parts that depend on it; move it forward",
        ),
        (
            ["magic: 0xAA", "id: u8", "payload: by_id", "{field: f, type: u8}", "{reserved: 4, when: f & 0x01}"],
            "8:25: `f` must be in the header, before the parts that depend on it; move it forward",
        ),
        (
            ["magic: 0xAA", "{check: {type: xor8, seed: message}}", "payload: 3", "id: u8"],
            "5:5: this check includes the message's seed, but the id that identifies the message is after the "
            "payload; move the id before it, or this check after the id",
        ),
    ],
)
def test_parts_that_do_not_go_together_are_refused(parts: list[str], problem: str) -> None:
    with pytest.raises(ProtocolFileError) as caught:
        loads(file(parts), "f")
    assert str(caught.value) == f"f:{problem}"


def test_a_size_that_a_length_in_words_cannot_express_is_not_sent() -> None:
    codec = Codec(loads(file(["magic: 0xAA", "id: u8", "length: {type: u8, unit: 4}", "payload: by_length"], ANY)))
    for size in range(9):
        values = list(range(size))
        if size % 4:
            with pytest.raises(MessageError, match="which the frame's length cannot express: it counts by 4"):
                codec.encode("a", x=values)
        else:
            (message,) = codec.decoder().feed(codec.encode("a", x=values))
            assert message.fields == {"x": values}


def test_a_frame_without_a_byte_is_not_sent() -> None:
    """Between two delimiters it would be fill."""
    text = file(["delimiter: 0xC0", "slip: [payload: rest]", "delimiter: 0xC0"], ANY.replace("id: 1, ", ""))
    codec = Codec(loads(text))
    with pytest.raises(MessageError, match="a is empty, and so is its frame"):
        codec.encode("a", x=[])
    assert codec.encode("a", x=[1]) == b"\xc0\x01\xc0"


def test_a_header_check_counts_the_seed_of_the_one_message_of_a_frame_without_an_id() -> None:
    parts = ["magic: 0xAA", "{check: {type: xor8, seed: message}}", "payload: 3"]
    codec = Codec(loads(file(parts, ONE.replace("id: 1,", "seed: 0x0F,"))))
    frame = codec.encode("a")
    assert frame == bytes([0xAA, 0xA5, 1, 0, 0])
    assert [m.fields for m in codec.decoder().feed(frame)] == [{"x": 1}]
