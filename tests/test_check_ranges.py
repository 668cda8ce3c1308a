"""Checks over several ranges: the order in which they count, around themselves, what `over:` refuses."""

from __future__ import annotations

import pytest

import wirebond
from tests.reference.checks import checksum
from wirebond.analysis.explain import explain
from wirebond.errors import ProtocolFileError
from wirebond.generate.doc import markdown
from wirebond.protocol import loads
from wirebond.protocol.hash import protocol_hash
from wirebond.protocol.model import End
from wirebond.protocol.spelling import part_text

FILE = """
wirebond: 1
protocol: ranges
byte_order: little
frame:
  - magic: 0xAA
  - id: u8
  - {check}
  - payload: 3
  - tail: 0x55
messages:
  say: {{sender: both, id: 7, fields: {{text: {{type: bytes, size: 3}}}}}}
"""


def codec(over: str, kind: str = "crc-16/modbus") -> wirebond.Codec:
    return wirebond.Codec(loads(FILE.format(check=f"check: {{type: {kind}, over: {over}}}")))


@pytest.mark.parametrize(
    ("over", "covered"),
    [
        ("[magic..id, payload..tail]", b"\xaa\x07abc\x55"),
        ("[payload, magic..id]", b"abc\xaa\x07"),
        ("[tail, id, payload]", b"\x55\x07abc"),
        ("[tail, payload, id, magic]", b"\x55abc\x07\xaa"),
        ("[id]", b"\x07"),
    ],
)
@pytest.mark.parametrize("kind", ["crc-16/modbus", "sum16", "fletcher-16", "{unit}"])
def test_the_ranges_are_counted_one_after_the_other(over: str, covered: bytes, kind: str) -> None:
    kind = kind.format(unit="xor, width: 16, unit: 2") if "unit" in kind else kind
    made = codec(over, kind)
    frame = made.encode("say", {"text": b"abc"})
    [algorithm] = [part.algorithm for part in made.model.format.parts if part.algorithm is not None]
    assert frame == b"\xaa\x07" + checksum(algorithm, covered).to_bytes(2, "little") + b"abc\x55"
    [message] = made.decoder("host").feed(frame)
    assert message.fields == {"text": b"abc"}
    for place in range(len(frame)):
        damaged = frame[:place] + bytes([frame[place] ^ 1]) + frame[place + 1 :]
        is_covered = 2 <= place < 4 or any(place in range(*ends) for ends in ends_of(over))
        assert bool(made.decoder("host").feed(damaged)) == (not is_covered and 1 < place < 7)


def ends_of(over: str) -> list[tuple[int, int]]:
    """First byte of each range, and the one behind its last."""
    starts = {"magic": (0, 1), "id": (1, 2), "payload": (4, 7), "tail": (7, 8)}
    return [(starts[one.split("..")[0]][0], starts[one.split("..")[-1]][1]) for one in over.strip("[]").split(", ")]


def test_a_header_check_may_leave_something_out() -> None:
    text = FILE.replace("  - payload: 3", "  - payload: by_length\n  - check: crc-16/modbus")
    text = text.replace("  - id: u8\n", "  - length: u8\n  - id: u8\n")
    made = wirebond.Codec(loads(text.format(check="{check: {type: sum8, over: [length, magic]}, name: head}")))
    frame = made.encode("say", {"text": b"abc"})
    assert frame[3] == (3 + 0xAA) % 256
    assert [m.name for m in made.decoder("host").feed(b"\xaa\x03\x07\x00" + frame)] == ["say"]


@pytest.mark.parametrize(
    ("over", "sentence"),
    [
        (
            "magic..payload",
            r"a check cannot cover itself; write `over: \[magic\.\.id, payload\.\.payload\]`, which leaves",
        ),
        ("[magic..id, id]", "`id` to `id` overlaps another range; name each part once"),
        ("[magic, id, payload, tail, tail]", "a check covers 1 to 4 ranges, not 5; join some, as in `id..payload`"),
        ("[]", "a check covers 1 to 4 ranges, not 0; join some"),
        ("[id..magic]", "the range's first part comes after its last; write `magic..id`"),
        ("[id, length]", "the frame has no part `length`"),
        ("[id, 7]", "`7` is not a range of parts; write `id..payload`, first and last part, or one part"),
    ],
)
def test_ranges_that_cannot_be(over: str, sentence: str) -> None:
    with pytest.raises(ProtocolFileError, match=sentence):
        codec(over)


def test_they_are_part_of_the_hash_and_written_as_in_the_file() -> None:
    around, other = codec("[magic..id, payload..tail]").model, codec("[payload..tail, magic..id]").model
    assert protocol_hash(around) != protocol_hash(other)
    assert "over: [magic..id, payload..tail]" in part_text(around.format.parts, 2)
    assert "covered by check" in markdown(wirebond.Codec(around))


def test_explain_finds_the_ranges_that_the_frames_have() -> None:
    sender, here = codec("[magic..id, payload..tail]"), codec("magic..id")
    frames = b"".join(sender.encode("say", {"text": text}) for text in (b"abc", b"xyz", b"123", b"qqq"))
    guesses = [stretch.guesses[0] for stretch in explain(here.model, frames, End.HOST).stretches if stretch.guesses]
    assert len(guesses) == 4
    assert all("over: [magic..id, payload..tail]" in guess.remedy for guess in guesses)
