"""Checks that are some bits of a part, alone or in pieces, and may cover the other bits of it."""

from __future__ import annotations

import random

import pytest

from tests.reference import decode
from tests.reference.checks import checksum
from wirebond.analysis.diff import compare
from wirebond.analysis.explain import explain
from wirebond.codec import Codec
from wirebond.errors import ProtocolFileError
from wirebond.generate.doc import markdown
from wirebond.protocol import loads
from wirebond.protocol.algorithms import find
from wirebond.protocol.hash import protocol_hash
from wirebond.protocol.model import End
from wirebond.protocol.spelling import part_text

TEXT = """\
wirebond: 1
protocol: bits
frame: [magic: 0x5A, {frame}]
messages: {{data: {{id: 1, sender: mcu, fields: {{data: {{type: bytes, size: 4}}}}}}}}
"""
COUNTED = "id: u8, payload: 4, {bits: u8, fields: {crc: {bits: 4, check: %s}, counter: 4}}"
OVER_ITSELF = COUNTED % "{type: crc-4/g-704, over: magic..bits}"
PIECES = (
    "id: u8, payload: 4, "
    "{bits: u8, fields: {high: {bits: 4, check: {type: sum8, over: id..payload}, from_bit: 4}, three: {bits: 4, "
    "constant: 3}}, name: one}, "
    "{bits: u8, fields: {low: {bits: 4, check: {type: sum8, over: id..payload}}, also: {bits: 4, constant: 3}}, "
    "name: two}"
)
HEADER = "{bits: u16be, fields: {id: 8, parity: {bits: 3, check: {type: crc-3/gsm, over: bits}}, spare: 5}}, payload: 4"


def codec(frame: str) -> Codec:
    return Codec(loads(TEXT.format(frame=frame)))


def test_its_own_bits_count_as_zeros() -> None:
    made = codec(OVER_ITSELF)
    raw = made.encode("data", data=b"abcd", header={"counter": 9})
    algorithm = find("crc-4/g-704")
    assert algorithm is not None
    assert raw[:-1] == b"\x5a\x01abcd"
    assert raw[-1] == 0x90 | checksum(algorithm, raw[:-1] + b"\x90")
    [message] = made.decoder("mcu").feed(raw)
    assert (message.fields["data"], message.header["counter"]) == (b"abcd", 9)


def test_a_value_is_in_two_pieces() -> None:
    made = codec(PIECES)
    raw = made.encode("data", data=bytes.fromhex("10 20 30 0f"))
    assert raw.hex() == "5a01" + "1020300f" + "3730"  # 0x70, a digit in each of two characters
    [message] = made.decoder("mcu").feed(raw)
    assert message.fields["data"].hex() == "1020300f"


def test_a_check_of_the_header_is_in_its_bits() -> None:
    made = codec(HEADER)
    raw = made.encode("data", data=b"abcd", header={"spare": 17})
    decoder = made.decoder("mcu")
    assert [message.fields["data"] for message in decoder.feed(raw[:1] + bytes([raw[1] ^ 1]) + raw[2:] + raw)] == [
        b"abcd"
    ]
    assert decoder.stats.as_dict()["rejected_candidates"]["header_check_mismatch"] > 0


@pytest.mark.parametrize("frame", [OVER_ITSELF, PIECES, HEADER], ids=["over itself", "in pieces", "of the header"])
def test_every_wrong_bit_that_the_reference_finds_is_found(frame: str) -> None:
    made = codec(frame)
    raw = made.encode("data", data=random.Random(3).randbytes(4))
    found = 0
    for bit in range(8 * len(raw)):
        damaged = bytearray(raw)
        damaged[bit // 8] ^= 1 << bit % 8
        expected = len(decode(made.model, bytes(damaged), End.MCU).frames)
        assert len(made.decoder("mcu").feed(bytes(damaged))) == expected, bit
        found += not expected
    assert found >= 24  # of the whole header, at the least


@pytest.mark.parametrize("frame", [OVER_ITSELF, PIECES, HEADER], ids=["over itself", "in pieces", "of the header"])
def test_the_file_is_spelled_and_documented(frame: str) -> None:
    made = codec(frame)
    parts = made.model.format.parts
    texts = [part_text(parts, index) for index, part in enumerate(parts) if part.in_bits is None]
    again = loads(TEXT.format(frame="HERE").replace("magic: 0x5A, HERE", ", ".join(texts)))
    assert again.format.parts == parts
    assert protocol_hash(again) == protocol_hash(made.model)
    text = markdown(made)
    assert "covered by" in text
    assert "over `" in text or " over " in text


def test_explain_says_what_the_check_should_be() -> None:
    made = codec(OVER_ITSELF)
    raw = made.encode("data", data=b"abcd", header={"counter": 3})
    wrong = raw[:-1] + bytes([raw[-1] ^ 1])
    [refused] = explain(made.model, wrong, End.MCU).stretches
    failed = [rule for rule in refused.rules if not rule.holds]
    assert [rule.expected for rule in failed] == [f"{raw[-1] & 15:02X}"]


def test_diff_names_the_part_once() -> None:
    other = codec(OVER_ITSELF.replace("crc-4/g-704", "crc-4/interlaken"))
    [change] = [change for change in compare(codec(OVER_ITSELF).model, other.model).changes if change.what == "frame"]
    assert change.sentence.count("became") == 1
    assert change.sentence.count("crc-4/interlaken") == 1


@pytest.mark.parametrize(
    ("frame", "sentence"),
    [
        (COUNTED % "{type: xor8, byte: high}", "`byte` is for a check with bytes of its own"),
        (COUNTED % "{type: xor8, text: hex}", "`text` is for a check with bytes of its own; remove it"),
        (COUNTED % "crc-3/gsm", "the check has 3 bits, and this run would be bits 0 to 3 of them"),
        (COUNTED.replace("check: %s", "check: xor8, from_bit: 5"), "this run would be bits 5 to 8 of them"),
        (COUNTED.replace("check: %s", "constant: 1, check: xor8"), "a run is a check, or something else"),
        (COUNTED.replace("check: %s", "from_bit: 5"), "`from_bit` is for a run that is a check; remove it"),
        (
            COUNTED.replace("counter: 4", "other: {bits: 4, check: xor8}") % "xor8",
            "`crc` is a check in these bits already; give this one bits of its own",
        ),
        (
            "{check: {type: xor8, over: bits}, name: early}, " + COUNTED % "{type: xor8, over: bits}",
            "this check covers a later one",
        ),
    ],
)
def test_the_impossible_gets_a_sentence(frame: str, sentence: str) -> None:
    with pytest.raises(ProtocolFileError) as error:
        codec(frame)
    assert sentence in str(error.value)
