"""`explain` and the decoder agree on any stream: frames, causes, values, field rules."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from tests.shared import (
    PROTOCOLS,
    ROOT,
    Rejected,
    Vector,
    accepted_vectors,
    codec,
    few_or_many,
    loaded,
    needs_sender,
    rejected_vectors,
)
from tests.streams import hard_stream, random_frame, random_values
from tests.test_against_reference import FORMATS, stream_for

from wirebond import Codec, Message
from wirebond.analysis.explain import Kind, explain
from wirebond.analysis.explain.layout import check_value, covered_bytes, spans
from wirebond.analysis.explain.scan import scan
from wirebond.analysis.explain.stuffing import stuff
from wirebond.analysis.explain.values import faults_of, read_fields, values_of
from wirebond.protocol import loads
from wirebond.protocol.model import End, PartKind
from wirebond.protocol.model import Message as MessageModel
from wirebond.protocol.planning import expecting

NAMES = ["diffdrive", "enterprize", "pid_tuner", "pid_tuner_listing", "native"]
VALUES = [*(PROTOCOLS / f"{name}.yaml" for name in NAMES), ROOT / "tests" / "generate" / "code" / "every_shape.yaml"]


def any_sender(proto: Codec) -> End | None:
    """None, both ends, where that can be told: else the MCU."""
    return End.MCU if needs_sender(proto.model) else None


STUFFED_AND_COUNTED = """
wirebond: 1
protocol: stuffed_and_counted
frame:
  - magic: 0xA5
  - STUFFING
  - check: crc-16/modbus
messages:
  list:
    id: 1
    sender: mcu
    fields:
      size: {type: u8}
      one:  {type: u16, count: {bytes: size}, max: 3}
      more: {type: u8}
      two:  {type: u8, count: more, max: 5}
"""


@few_or_many(10, 100)
@pytest.mark.parametrize(
    "stuffing",
    [
        "escaped: {escape: 0x7D, xor: 0x20, also: 0x01 0x02, parts: [id: u8, payload: by_id]}",
        "inserted: {after: 0x01 0x02, byte: 0x03, parts: [id: u8, payload: by_id]}",
    ],
)
def test_counts_give_the_size_of_a_stuffed_frame(stuffing: str, number: int) -> None:
    proto = Codec(loads(STUFFED_AND_COUNTED.replace("STUFFING", stuffing)))
    for seed in range(number):
        source = random.Random(seed)
        sizes = [source.randrange(4), source.randrange(6)]
        frame = proto.encode("list", one=[0x201] * sizes[0], two=[source.randrange(4) for _ in range(sizes[1])])
        (stretch,) = explain(proto.model, frame, End.MCU).stretches
        assert (stretch.kind, stretch.message) == (Kind.FRAME, "list")
        stream = hard_stream(proto, source, 40) + bytes(source.choices([0xA5, 0, 1, 2, 3, 0x7D, 0x21], k=60))
        found = scan(proto.model, stream, End.MCU)
        decoder = proto.decoder(End.MCU)
        messages = decoder.feed(stream) + decoder.finish()
        assert [(f.offset, f.size) for f in found.frames] == [(m.offset, len(m.raw)) for m in messages], f"seed {seed}"
        assert dict(found.discarded) == decoder.stats.as_dict()["discarded_bytes"], f"seed {seed}"
        assert dict(found.rejected) == decoder.stats.as_dict()["rejected_candidates"], f"seed {seed}"


@few_or_many(15, 400)
@pytest.mark.parametrize("name", sorted(FORMATS))
def test_random_bytes_are_examined_alike(name: str, number: int) -> None:
    """Bytes of few values, so that starts, lengths and delimiters occur."""
    proto = loaded(FORMATS[name])
    source = random.Random(name)
    first = random_frame(proto, source)
    for _ in range(number):
        stream = bytes(source.choices([*first[:6], 0, 1, 2, 0xFF], k=source.randrange(1, 80)))
        found = scan(proto.model, stream, any_sender(proto))
        decoder = proto.decoder(any_sender(proto))
        messages = decoder.feed(stream) + decoder.finish()
        assert [f.offset for f in found.frames] == [m.offset for m in messages], stream.hex()
        assert dict(found.discarded) == decoder.stats.as_dict()["discarded_bytes"], stream.hex()


@few_or_many(1, 12)
@pytest.mark.parametrize("name", sorted(FORMATS))
def test_every_byte_is_in_one_stretch_and_frames_carry_the_decoders_values(name: str, number: int) -> None:
    proto = loaded(FORMATS[name])
    pieces = 6 if proto.model.format.max_payload < 256 else 2  # every byte of a frame is a row or more
    for seed in range(number):
        stream = stream_for(proto, random.Random(f"{name} {seed}"), pieces)
        explanation = explain(proto.model, stream, any_sender(proto))
        assert b"".join(stretch.wire for stretch in explanation.stretches) == stream
        decoder = proto.decoder(any_sender(proto))
        messages = decoder.feed(stream) + decoder.finish()
        assert [(f.offset, f.message) for f in explanation.frames] == [(m.offset, m.name) for m in messages]
        for frame, message in zip(explanation.frames, messages, strict=True):
            assert frame.header == message.header
            if message.name != "unknown":
                assert frame.values == message.fields
                assert len(frame.faults) == len(message.violations), (frame.faults, message.violations)


@pytest.mark.parametrize("path", VALUES, ids=lambda path: path.stem)
def test_values_and_broken_field_rules_are_the_engines(path: Path) -> None:
    """Random payloads: values beyond every range, numbers without a name, NaN, text that is not UTF-8, wrong counts."""
    proto = loaded(path)
    source = random.Random(path.stem)
    for message in proto.model.messages:
        for _ in range(100):
            payload = source.randbytes(source.randint(message.min_payload, message.max_payload))
            if source.random() < 0.5:  # small numbers, so that counts are often right
                payload = bytes(byte % 4 for byte in payload)
            (decoded,) = _frame_with(proto, message, payload)
            readings = read_fields(message, decoded.payload[: message.max_payload])
            assert repr(values_of(readings)) == repr(decoded.fields), (message.name, payload.hex())
            assert len(faults_of(readings)) == len(decoded.violations), (faults_of(readings), decoded.violations)


def _frame_with(proto: Codec, described: MessageModel, payload: bytes) -> list[Message]:
    """The engine's message for a frame with this payload, its checks worked out by `explain`."""
    frame_format = proto.model.format
    size = next(p.fixed_payload for p in frame_format.parts if p.kind == PartKind.PAYLOAD)
    payload = payload.ljust(size, b"\0")[: size or None]
    data = bytearray()
    for part, (start, _) in zip(frame_format.parts, spans(frame_format.parts, len(payload)), strict=True):
        assert len(data) == start
        order = "big" if part.order == "big" else "little"
        if part.kind == PartKind.PAYLOAD:
            data += payload
        elif part.kind == PartKind.ID:
            data += described.id.to_bytes(part.size, order)
        elif part.kind == PartKind.LENGTH:
            data += len(payload).to_bytes(part.size, order)
        elif part.kind == PartKind.CHECK:
            places = spans(frame_format.parts, len(payload))
            index = frame_format.parts.index(part)
            data += check_value(part, covered_bytes(frame_format.parts, index, bytes(data), places), seed=0)
        else:
            data += part.value or bytes(part.size)
    wire = bytes(data)
    if frame_format.delimiter is not None:
        wire = (frame_format.opening or b"") + stuff(frame_format, wire) + frame_format.delimiter
    return proto.decoder(End.HOST if described.sender == End.BOTH else described.sender).feed(wire)


@pytest.mark.parametrize("vector", accepted_vectors(), ids=str)
def test_a_vector_is_one_frame_with_every_byte_named(vector: Vector) -> None:
    (stretch,) = explain(codec(vector.protocol).model, vector.frame, End(vector.sender)).stretches
    assert (stretch.kind, stretch.message, stretch.values) == (Kind.FRAME, vector.message, vector.fields)
    named = b"".join(row.wire for row in stretch.rows if row.level == 0)
    assert named == vector.frame
    assert all(rule.holds for rule in stretch.rules)


@pytest.mark.parametrize("rejected", rejected_vectors(), ids=str)
def test_a_wrong_worked_example_is_refused_and_read_as_if_it_were_right(rejected: Rejected) -> None:
    proto = codec(rejected.protocol)
    (stretch,) = explain(proto.model, rejected.frame, End.HOST).stretches
    assert (stretch.kind, stretch.cause) == (Kind.REFUSED, "check_mismatch")
    failed = [rule for rule in stretch.rules if not rule.holds]
    assert failed == [stretch.rules[-1]]
    right = bytes.fromhex(failed[0].expected)
    at = rejected.frame.rindex(bytes.fromhex(failed[0].found))
    repaired = rejected.frame[:at] + right + rejected.frame[at + 1 :]
    (message,) = proto.decoder("host").feed(repaired)
    assert f"with check {right.hex().upper()} this is {message.name}: " in stretch.repaired


def test_the_pid_frame_is_explained_by_the_listing() -> None:
    (rejected,) = [r for r in rejected_vectors() if r.protocol == "pid_tuner"]
    peers = [codec(name).model for name in NAMES if name != "pid_tuner"]
    (stretch,) = explain(codec("pid_tuner").model, rejected.frame, End.HOST, peers).stretches
    best = stretch.guesses[0]
    assert "over `length..payload`, without the id" in best.what
    assert "pid_tuner_listing computes it so" in best.what
    assert best.remedy == "Write `- check: {type: sum16, byte: high, over: length..payload}`."


@few_or_many(25, 100)
@pytest.mark.parametrize("name", sorted(FORMATS))
def test_every_byte_of_any_frame_has_a_name(name: str, number: int) -> None:
    """And stuffing done in Python gives the engine's bytes again."""
    proto = loaded(FORMATS[name])
    frame_format = proto.model.format
    source = random.Random(name)
    for _ in range(number):
        message = source.choice(proto.model.messages)
        sender = End.HOST if message.sender == End.BOTH else message.sender
        wire = proto.encode(message.name, random_values(message, source))
        model = expecting(proto.model, message.name)
        (stretch,) = explain(model, wire, sender).stretches
        assert (stretch.kind, stretch.message) == (Kind.FRAME, message.name)
        assert b"".join(row.wire for row in stretch.rows if row.level == 0) == wire
        assert all(rule.holds for rule in stretch.rules)
        (found,) = scan(model, wire, sender).frames
        assert stuff(frame_format, found.content.data) == found.content.block
