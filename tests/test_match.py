"""Messages that more than one id tells: header fields, several ids, the payload's size, a number in the payload."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from tests import reference
from tests.conformance.formats import Chunk, Job, build_formats, decode_all
from tests.shared import ROOT
from tests.streams import hard_stream, random_values
from wirebond import Codec, MessageError, load
from wirebond.analysis.explain import explain
from wirebond.generate.doc import markdown
from wirebond.protocol import ProtocolFileError, protocol_hash
from wirebond.protocol.loader import loads
from wirebond.protocol.model import End
from wirebond.protocol.planning import expecting, ids_collide, plan_for, told_by_request

CODEC = load(ROOT / "tests" / "formats" / "matched.yaml")


def received(frame: bytes, sender: str) -> list[tuple[str, dict[str, Any], dict[str, Any]]]:
    decoder = CODEC.decoder(sender)
    return [(m.name, m.fields, m.header) for m in decoder.feed(frame) + decoder.finish()]


@pytest.mark.parametrize(
    ("name", "values", "header", "sender", "wire"),
    [
        ("read", {"index": 2}, {}, "host", "a5 00 01 01 02"),
        ("read_notice", {}, {}, "host", "a5 02 00 01"),
        ("answer", {"value": -1}, {}, "mcu", "a5 01 02 01 ff ff"),
        ("failed", {"code": 3}, {}, "mcu", "a5 00 01 80 03"),
        ("failed", {"code": 3}, {"id": 0x91}, "mcu", "a5 00 01 91 03"),
        ("ask", {"item": 1}, {}, "host", "a5 00 02 02 01 00"),
        ("set", {"item": 1, "values": [1, 2, 3]}, {}, "host", "a5 00 08 02 01 00 01 00 02 00 03 00"),
        ("stop_motor", {}, {}, "host", "a5 00 01 03 01"),
        ("run_motor", {"command": 6, "speed": 1}, {}, "host", "a5 00 03 03 06 01 00"),
        ("set_mode", {"flags": {"low": 1, "rest": 2}, "detail": 5}, {}, "mcu", "a5 00 04 04 02 31 05 00"),
        ("pair", {"value": 1}, {"id": 0x12, "hops": 2}, "mcu", "a5 08 01 12 01"),
        ("odd", {}, {"id": 0x2F}, "mcu", "a5 00 00 2f"),
        ("motor_speed", {"part": 9, "head": {"number": 5}, "speed": 3}, {}, "mcu", "a5 00 06 05 09 01 05 00 03 00"),
        (
            "motor_current",
            {"part": 1, "head": {"part": 6, "number": 5}, "current": 3, "spare": {"part": 1, "number": 0}},
            {},
            "mcu",
            "a5 00 09 05 01 06 05 00 03 00 01 00 00",
        ),
        ("motor_log", {"head": {"part": 4, "number": 5}}, {}, "host", "a5 00 04 06 03 04 05 00"),
        (
            "motor_mark",
            {"head": {"part": 3, "number": 5}, "last": {"of": {"rest": 1}}},
            {},
            "host",
            "a5 00 05 06 04 03 05 00 09",
        ),
    ],
)
def test_a_sender_writes_the_identifying_values_and_a_receiver_reads_them(
    name: str, values: dict[str, Any], header: dict[str, Any], sender: str, wire: str
) -> None:
    frame = CODEC.encode(name, values, header=header)
    assert frame[:-2].hex(" ") == wire
    ((found, fields, seen),) = received(frame, sender)
    assert (found, fields) == (name, values)
    assert seen["id"] == frame[3]
    assert {key: seen[key] for key in header} == header


@pytest.mark.parametrize(
    ("name", "values", "header", "sentence"),
    [
        ("failed", {"code": 3}, {"id": 0x11}, "header.id is 17 (0x11); frames of failed have 128 (0x80) to 255 (0xFF)"),
        ("pair", {"value": 1}, {"hops": 9}, "header.hops is 9 (0x09); frames of pair have 0 (0x00) to 3 (0x03)"),
        (
            "read",
            {"index": 1},
            {"kind": "reply"},
            "header.kind is 1 (0x01); frames of read have 0 (0x00), which is sent by itself: leave it out",
        ),
        (
            "run_motor",
            {"command": 3, "speed": 1},
            {},
            "run_motor.command is 3 (0x03); its frames are identified by 2 (0x02), 5 (0x05) to 9 (0x09) there",
        ),
        (
            "add",
            {"item": 1, "data": b""},
            {},
            "the payload of add has 2 bytes; its frames are identified by 9 (0x09) to 12 (0x0C) there",
        ),
        (
            "motor_current",
            {"part": 2, "head": {"part": 1, "number": 5}, "current": 3, "spare": {"part": 2, "number": 0}},
            {},
            "motor_current.head.part is 1 (0x01); its frames are identified by 2 (0x02), 5 (0x05) to 9 (0x09) there",
        ),
        ("stop_motor", {"command": 1}, {}, "stop_motor has no field 'command'; it has no fields"),
    ],
)
def test_a_sender_refuses_what_is_another_message(
    name: str, values: dict[str, Any], header: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(MessageError) as raised:
        CODEC.encode(name, values, header=header)
    assert str(raised.value).startswith(sentence)


def test_an_id_that_the_message_does_not_have_is_refused_where_only_the_other_ends_messages_have_several() -> None:
    codec = load(ROOT / "protocols" / "contrib" / "dynamixel_1.yaml")
    action = codec.encode("action")
    assert codec.encode("action", header={"id": 5}) == action
    for other in (1, 7, 0x85):  # 1 shares its only bit with 5
        with pytest.raises(MessageError, match=r"header.id is \d+ .*; frames of action have 5 .*: leave it out"):
            codec.encode("action", header={"id": other})


def test_a_size_that_is_matched_is_exact_and_any_other_is_unknown() -> None:
    assert CODEC.model.format.deliver_unknown
    longer = CODEC.encode("add", item=1, data=bytes(8))  # 10 bytes: not `set`, which has 8
    assert [name for name, _, _ in received(longer, "host")] == ["add"]
    plain = load_text(
        "frame: [magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-16/modbus]\n"
        "max_payload: 20\n"
        "messages:\n"
        "  ask: {id: 2, sender: host, match: {size: 2}, fields: {item: {type: u16}}}\n"
        "  any: {id: 3, sender: host, fields: {item: {type: bytes, max: 20}}}\n"
    )
    other = plain.encode("any", item=b"abc")
    for size in range(6):
        frame = bytearray(plain.encode("any", item=bytes(size))[:-2])
        frame[2] = 2
        (message,) = plain.decoder("host").feed(sealed(bytes(frame)) + other)[:1]
        assert message.name == ("ask" if size == 2 else "unknown")


def sealed(frame: bytes) -> bytes:
    check = 0xFFFF
    for byte in frame:
        check ^= byte
        for _ in range(8):
            check = check >> 1 ^ (0xA001 if check & 1 else 0)
    return frame + check.to_bytes(2, "little")


def load_text(text: str) -> Codec:
    return Codec(loads(f"wirebond: 1\nprotocol: demo\n{text}"))


def test_plans_tests_and_replies() -> None:
    host, mcu = plan_for(CODEC.model, End.HOST), plan_for(CODEC.model, End.MCU)
    assert (host.matches, host.matches_late, mcu.matches_late) == (True, True, True)
    assert host.header[host.id_place or 0].name == "id"
    assert all(row.tests for row in (*host.messages, *mcu.messages))
    native = plan_for(load(ROOT / "protocols" / "native.yaml").model, End.HOST)
    assert (native.matches, native.id_place) == (False, None)
    assert not any(row.tests for row in native.messages)


REPLIES = """
frame: [magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
messages:
  ask: {id: 1, sender: host, reply: answer}
  look: {id: 2, sender: host, reply: seen}
  answer: {id: 0x80..0xFF, sender: mcu, fields: {value: {type: u8}}}
  seen: {id: [0x80, 0x90], sender: mcu, fields: {other: {type: u8}}}
  spoke: {id: [0x01, 0x03], sender: mcu}
"""


def test_a_reply_that_looks_like_another_is_meant_where_it_was_asked_for() -> None:
    codec = load_text(REPLIES)
    assert told_by_request(codec.model.messages, End.MCU) == {"answer", "seen"}
    assert [(a.name, b.name) for a, b in ids_collide(codec.model)] == [("ask", "spoke")]
    assert [m.name for m in expecting(codec.model, "seen").messages] == ["ask", "look", "seen", "spoke"]
    frame = codec.encode("seen", other=5)
    for request, name in ((None, "unknown"), ("ask", "answer"), ("look", "seen")):
        decoder = codec.decoder("mcu")
        decoder.expect(request)
        assert [m.name for m in decoder.feed(frame)] == [name]
        assert [f.name for f in reference.decode(codec.model, frame, End.MCU, request).frames] == [name]


def test_a_name_is_the_field_with_this_path_before_one_within_a_struct() -> None:
    fields = "{part: {type: u8}, head: {struct: {part: {type: u8}}}, bits: {bits: {type: u8, fields: {part: u8}}}}"
    fields = fields.replace("part: u8", "part: {type: u8}")
    for path, wire in (("part", "01 02 03"), ("head.part", "02 01 03"), ("bits.part", "02 03 01")):
        codec = load_text(with_messages(f"  a: {{id: 1, sender: host, match: {{{path}: 1}}, fields: {fields}}}\n"))
        (match,) = codec.model.messages[0].match
        assert match.name == path
        left = [place for place in ("part", "head.part", "bits.part") if place != path]
        values: dict[str, Any] = {"head": {}, "bits": {}}
        for number, place in enumerate(left, 2):
            outer, _, inner = place.partition(".")
            (values[outer] if inner else values)[inner or outer] = number
        frame = codec.encode("a", {name: value for name, value in values.items() if value != {}})
        assert frame[4:-2].hex(" ") == wire


def test_a_path_and_the_bare_name_that_means_the_same_are_the_same_protocol() -> None:
    fields = "{head: {struct: {part: {type: u8}}}}"
    bare, path = (
        load_text(with_messages(f"  a: {{id: 1, sender: host, match: {{{name}: 1}}, fields: {fields}}}\n")).model
        for name in ("part", "head.part")
    )
    assert bare == path
    assert protocol_hash(bare) == protocol_hash(path)


LENGTH = "field: kind, type: u8}, {length: u8}, {id: u8}, {payload: by_length}, {check: crc-16/modbus"


def faults(text: str) -> list[str]:
    with pytest.raises(ProtocolFileError) as raised:
        load_text(text)
    return [line.split(": ", 1)[1] for line in str(raised.value).splitlines()]


def with_messages(messages: str, frame: str = LENGTH) -> str:
    return f"frame: [{{magic: 0xA5}}, {{{frame}}}]\nmessages:\n{messages}"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            with_messages("  a: {id: 1..5, sender: host}\n  b: {id: [3, 9], sender: host}\n"),
            "the host sends `a` (line 5) and `b`, and a frame with the id 3 (0x03) fits both; distinguish them by "
            "`id` or `match`, or make one the `reply` of its request",
        ),
        (
            with_messages("  a: {id: 1, sender: host, match: {kind: 1}}\n  b: {id: 1, sender: host}\n"),
            "the host sends `a` (line 5) and `b`, and a frame with the id 1 (0x01), `kind` 1 (0x01) fits both; "
            "distinguish them by `id` or `match`, or make one the `reply` of its request",
        ),
        (
            with_messages("  a: {id: 1, sender: host, match: {kin: 1}}\n"),
            "`kin` is neither a field of the header nor an unsigned number at a constant place of this message; did "
            "you mean `kind`? (possible: kind, size)",
        ),
        (
            with_messages("  a: {id: 1, sender: host, match: {kind: 256}}\n"),
            "`kind` has 8 bits, and 256 does not fit; the maximum is 255",
        ),
        (
            with_messages("  a: {id: 1, sender: host, match: {size: 3}, fields: {x: {type: u16}}}\n"),
            "`a` has 2 payload bytes, and none of these sizes; write 2",
        ),
        (
            with_messages("  a: {id: 1, sender: host, match: {id: 3}}\n"),
            "the id is not part of `match`; write `id: 0x80..0xFF` in the message",
        ),
        (
            with_messages("  a: {id: [1, 2], sender: host}\n", LENGTH.replace("kind", "id")),
            "`a` has several ids, so received frames have a header field `id`, but the frame already has a field of "
            "that name; rename that field",
        ),
        (
            with_messages("  a: {id: 1, sender: host, match: {x: 3}, fields: {x: {type: u8}}}\n",
                          "id: u8}, {payload: by_id}, {check: crc-16/modbus"),
            "with `payload: by_id` the size of `a` must be known before its payload, but its `match` is not; match a "
            "field before the payload, or use a frame with a length",
        ),
        (
            with_messages("  a: {id: 1, sender: host, match: {size: 1}, fields: {x: {type: u8}}}\n",
                          "id: u8}, {payload: 4}, {check: crc-16/modbus"),
            "every payload has the same size in this frame; match something else",
        ),
        (
            with_messages("  a: {id: [1, 2], sender: host, seed: 3}\n",
                          "length: u8}, {id: u8}, {payload: by_length}, {check: {type: crc-16/modbus, seed: message}"),
            "with `seed: message` the id alone must determine the seed; give `a` one id and no `match`, or remove "
            "`seed: message`",
        ),
        (
            with_messages("  a: {id: 1, sender: host, match: {servo: 1}}\n", LENGTH.replace(
                "field: kind, type: u8", "field: servo, type: u8, address: mcu")),
            "`servo` is an address, so it cannot identify a message; match another field",
        ),
        (
            with_messages("  a: {id: {mask: 0x80, value: 0x81}, sender: host}\n"),
            "0x81 has bits that 0x80 does not select; a frame never has them",
        ),
        (
            with_messages("  a: {id: 1, sender: host, match: {kind: {}}}\n"),
            "bits need a mask and a value, and nothing else; write `{mask: 0x80, value: 0x80}`",
        ),
        (
            with_messages("  a: {id: 1, sender: host, match: {part: 1}, fields: {x: {struct: {part: {type: u8}}}, "
                          "y: {bits: {type: u8, fields: {part: {type: u8}}}}}}\n"),
            "`part` could be `x.part` or `y.part` in this message; write the whole path of the one you mean",
        ),
        (
            with_messages("  a: {id: 1, sender: host, match: {part: 1, x.part: 2}, fields: {x: {struct: {part: "
                          "{type: u8}}}}}\n"),
            "`x.part` is matched twice; write it once",
        ),
        (
            with_messages("  a: {id: 1, sender: host, match: {z.part: 1}, fields: {x: {struct: {part: {type: u8}}}}}"),
            "`z.part` is neither a field of the header nor an unsigned number at a constant place of this message; did "
            "you mean `x.part`? (possible: kind, x.part, size)",
        ),
        (
            with_messages("  a: {id: 1, sender: host, match: {n: 2}, fields: {n: {type: u8}, v: {type: u8, count: n, "
                          "max: 4}}}\n"),
            "`n` counts other fields, and their number is free; match another field",
        ),
        (
            with_messages("  a: {id: 1, sender: host, match: {x..y: 1}}\n"),
            "`x..y` is not a name; a name has letters, digits and single underscores, a letter first",
        ),
    ],
)  # fmt: skip
def test_mistakes_of_a_match_are_reported(text: str, sentence: str) -> None:
    assert sentence in faults(text)


def test_the_hash_covers_the_conditions_of_messages() -> None:
    one, two = (
        load_text(with_messages(f"  a: {{id: {ids}, sender: host}}\n")).model for ids in ("0x01", "[0x01, 0x02]")
    )
    assert protocol_hash(one) != protocol_hash(two)


def test_explain_and_doc_say_how_a_message_is_identified() -> None:
    text = markdown(CODEC)
    assert "Id 0x80..0xFF, sent by the MCU." in text
    assert "with kind 1" in text
    assert "Id 0x21 with mask 0xF1" in text
    failed = explain(CODEC.model, CODEC.encode("failed", code=3, header={"id": 0x91}), End.MCU)
    assert failed.stretches[0].message == "failed"
    unknown = explain(CODEC.model, sealed(bytes([0xA5, 3, 0, 1])), End.HOST)
    assert "of the messages with the id 0x01 it is none: read (kind 0), read_notice (kind 2)" in str(
        unknown.stretches[0].summary
    )


@pytest.mark.live
def test_generated_code_reads_and_writes_the_same_frames(tmp_path: Path) -> None:
    program = build_formats([CODEC.model], {0}, sanitize=True)
    for sender in (End.HOST, End.MCU):
        source = random.Random(f"match {sender}")
        stream = b""
        sent = [m for m in CODEC.model.messages if m.sent_by(sender)]
        for _ in range(300):
            message = source.choice(sent)
            stream += CODEC.encode(message.name, random_values(message, source), sender=sender)
        stream += hard_stream(CODEC, source, pieces=80)
        answer = decode_all(program, [Job(0, sender, [Chunk(0, stream)])], tmp_path).jobs[0]
        decoder = CODEC.decoder(sender)
        messages = decoder.feed(stream) + decoder.finish()
        names = [m.name for m in CODEC.model.messages]
        found = [(f.offset, f.wire, f.message) for f in answer.deframed.frames]
        assert (
            found[: len(messages)]
            == [(m.offset, m.raw, names.index(m.name) if m.name in names else -1) for m in messages][: len(found)]
        )
        for place, handed in answer.handed.items():
            assert handed.with_header == messages[place].raw
