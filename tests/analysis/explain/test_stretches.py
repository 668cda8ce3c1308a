"""Every byte named, and what a stretch says of itself."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.cost import calls

from wirebond.analysis.explain import Kind, State, explain, parts
from wirebond.analysis.explain.explanation import MOST_BYTES, Explanation
from wirebond.analysis.explain.stuffing import Unstuffed, stuff, unstuff
from wirebond.codec import Codec
from wirebond.errors import UsageError
from wirebond.protocol import loads
from wirebond.protocol.model import End, PartKind

FILE = """\
wirebond: 1
protocol: arm
frame:
  - magic: 0xAA
  - length: {type: u8, counts: frame}
  - id: u8
  - check: crc-8/smbus
    name: header_check
  - payload: by_length
  - check: crc-16/mcrf4xx
messages:
  pose:
    id: 0x01
    sender: host
    fields:
      angle: {type: i16, unit: rad, scale: 0.001, range: [-1, 1]}
      mode: {type: u8, enum: {idle: 0, run: 1}}
      name: {type: text, max: 8}
  halt: {id: 0x02, sender: both}
"""
STUFFED = FILE[: FILE.index("frame:")] + (
    "frame: [delimiter: 0x00, cobs: [id: u8, payload: rest, check: crc-16/ibm-sdlc], delimiter: 0x00]\n"
    + FILE[FILE.index("messages:") :]
)
ESCAPED = STUFFED.replace("delimiter: 0x00", "delimiter: 0x7E").replace("cobs:", "hdlc:")
MODEL = loads(FILE)
CODEC = Codec(MODEL)
POSE = CODEC.encode("pose", angle=0.5, mode="run", name="elbow")


def test_each_part_and_field_has_its_row() -> None:
    (stretch,) = explain(MODEL, POSE, End.HOST).stretches
    rows = [(row.level, row.name, row.offset, row.wire.hex(), row.meaning) for row in stretch.rows]
    assert rows == [
        (0, "magic", 0, "aa", "begins every frame"),
        (0, "length", 1, "0e", "14 bytes of the whole frame: 8 in the payload"),
        (0, "id", 2, "01", "pose, from the host"),
        (0, "header_check", 3, POSE[3:4].hex(), "crc-8/smbus over magic..id: holds"),
        (0, "payload", 4, POSE[4:12].hex(), "8 bytes of pose"),
        (1, "angle", 4, "f401", "0.5 rad (500 * 0.001)"),
        (1, "mode", 6, "01", "run (1)"),
        (1, "name", 7, b"elbow".hex(), '"elbow"'),
        (0, "check", 12, POSE[12:].hex(), "crc-16/mcrf4xx over magic..payload: holds"),
    ]
    assert stretch.summary == 'pose from the host: angle 0.5 rad, mode run, name "elbow"'


@pytest.mark.parametrize(
    ("part", "row", "meaning"),
    [
        ("{sequence: u8}", "sequence", "7: rises by one from frame to frame"),
        ("{sequence: u8, per: message}", "sequence", "7: rises by one from frame to frame of the same message"),
        (
            "{bits: u8, fields: {sequence: {bits: 4, per: message}, hops: 4}}",
            "bits",
            "sequence 7 (rises by one from frame to frame of the same message), hops 0",
        ),
    ],
)
def test_it_says_what_a_sequence_number_counts(part: str, row: str, meaning: str) -> None:
    text = f"wirebond: 1\nprotocol: n\nframe: [magic: 0x55, {part}, id: u8, payload: 1, check: xor8]\n"
    model = loads(text + "messages: {go: {id: 1, sender: host, fields: {x: {type: u8}}}}\n")
    frame = Codec(model).encode("go", x=1, header={"sequence": 7})
    (stretch,) = explain(model, frame, End.HOST).stretches
    assert [found.meaning for found in stretch.rows if found.name == row] == [meaning]


def test_the_rules_are_listed_in_the_decoders_order_up_to_the_one_that_fails() -> None:
    broken = POSE[:3] + bytes([POSE[3] ^ 1]) + POSE[4:]
    (stretch,) = explain(MODEL, broken, End.HOST).stretches
    assert stretch.cause == "header_check_mismatch"
    assert [(rule.rule.split(",")[0], rule.holds) for rule in stretch.rules] == [
        ("magic", True),
        ("length", True),
        ("header_check", False),
    ]
    wrong = [row.name for row in stretch.rows if row.state == State.WRONG]
    assert wrong == ["header_check"]
    assert f"found {broken[3]:02X}" in stretch.summary


def test_broken_field_rules_are_reported_of_a_delivered_frame() -> None:
    loose = Codec(loads(FILE.replace(", range: [-1, 1]", "").replace(", run: 1", ", run: 1, other: 9")))
    frame = loose.encode("pose", angle=2.5, mode="other", name="x")
    (stretch,) = explain(MODEL, frame, End.HOST).stretches
    assert stretch.kind == Kind.FRAME
    assert stretch.faults == ("angle is outside -1 to 1 rad", "mode is 9, which has no name")
    assert [row.name for row in stretch.rows if row.state == State.WRONG] == ["angle", "mode"]


def test_noise_frames_and_remains_lie_side_by_side() -> None:
    data = b"\x01\x02" + POSE + b"\x00" + POSE[:5]
    stretches = explain(MODEL, data, End.HOST).stretches
    assert [(s.kind, s.offset, len(s.wire), s.cause) for s in stretches] == [
        (Kind.NOISE, 0, 2, "no_start"),
        (Kind.FRAME, 2, 14, ""),
        (Kind.NOISE, 16, 1, "no_start"),
        (Kind.REFUSED, 17, 5, "incomplete"),
    ]


def test_two_damaged_frames_are_two_stretches() -> None:
    broken = POSE[:7] + b"E" + POSE[8:]
    stretches = explain(MODEL, broken * 2, End.HOST).stretches
    assert [(s.offset, s.cause) for s in stretches] == [(0, "check_mismatch"), (14, "check_mismatch")]
    assert all("bit 5 of byte" in stretch.guesses[0].what for stretch in stretches)


def test_a_payload_longer_than_the_file_knows_is_named_to_the_end() -> None:
    longer = Codec(loads(FILE.replace("max: 8", "max: 12")))
    wide = loads(FILE.replace("messages:", "max_payload: 40\nmessages:"))
    frame = longer.encode("pose", angle=0, mode=0, name="shoulder_end")
    (stretch,) = explain(wide, frame, End.HOST).stretches
    rest = next(row for row in stretch.rows if row.level == 1 and row.name == "rest")
    assert (rest.wire, rest.meaning) == (b"_end", "more than the file describes: ignored")


def test_stuffed_frames_show_both_bytes_and_name_what_stuffing_added() -> None:
    model = loads(STUFFED)
    frame = Codec(model).encode("pose", angle=0.256, mode=0, name="a")
    (stretch,) = explain(model, frame, End.HOST).stretches
    rows = {row.name: row for row in stretch.rows}
    assert (rows["angle"].wire, rows["angle"].data) == (frame[3:5], b"\x00\x01")
    assert rows["angle"].wire[0] != 0
    assert rows["stuffing"].meaning == "COBS code: a zero stands 2 bytes on"
    assert [row.meaning for row in stretch.rows if row.name == "delimiter"] == ["opens the frame", "ends the frame"]
    assert b"".join(row.wire for row in stretch.rows if row.level == 0) == frame


@given(st.binary(max_size=600))
def test_stuffing_can_be_undone_and_keeps_every_place(data: bytes) -> None:
    for text in (STUFFED, ESCAPED):
        frame_format = loads(text).format
        assert frame_format.delimiter is not None
        block = stuff(frame_format, data)
        assert frame_format.delimiter not in block
        found = unstuff(frame_format, block)
        assert isinstance(found, Unstuffed)
        assert found.data == data
        placed = [at for start, stop in found.places for at in range(start, stop)]
        assert sorted([*placed, *(at for at, _ in found.added)]) == list(range(len(block)))


def test_a_frame_that_the_file_does_not_list_is_reported_with_its_id() -> None:
    other = Codec(loads(FILE.replace("id: 0x02", "id: 0x33")))
    (stretch,) = explain(MODEL, other.encode("halt"), End.HOST).stretches
    assert (stretch.message, stretch.kind) == ("unknown", Kind.FRAME)
    assert "no message of the host has the id 0x33" in stretch.summary


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=120), st.sampled_from([None, End.HOST, End.MCU]), st.sampled_from([FILE, STUFFED]))
def test_any_bytes_are_explained_whole(data: bytes, sender: End | None, text: str) -> None:
    explanation = explain(loads(text), data, sender)
    assert b"".join(stretch.wire for stretch in explanation.stretches) == data
    for stretch in explanation.stretches:
        for row in stretch.rows:
            assert data[row.offset : row.offset + len(row.wire)] == row.wire


def test_more_bytes_than_can_be_explained_are_refused_with_advice() -> None:
    with pytest.raises(UsageError, match=r"4097 bytes are too many .* `wirebond decode`"):
        explain(MODEL, bytes(MOST_BYTES + 1))


@pytest.mark.parametrize(
    "data", [b"\xaa" * MOST_BYTES, b"\xaa\x0e\x01" * 1365, bytes(MOST_BYTES)], ids=["aa", "head", "0"]
)
def test_the_worst_bytes_are_explained_in_bounded_time(data: bytes) -> None:
    found: list[Explanation] = []
    cost = calls(lambda: found.append(explain(MODEL, data)))
    assert cost < 4_000_000
    (explanation,) = found
    assert len(explanation.stretches) < len(data) / 4


def test_every_kind_of_part_has_its_words() -> None:
    assert set(parts._WORDS) == set(PartKind)
