"""Conditions of every kind, at both ends: which form is sent, and that a frame that breaks a condition is refused."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from tests import reference
from tests.conformance.build import build_decoder, decode
from tests.shared import ROOT, loaded
from tests.test_forms import CRC, printed_by_cpp, protocol
from wirebond import Codec, MessageError, UsageError
from wirebond.analysis.explain import Kind, explain
from wirebond.errors import ProtocolFileError
from wirebond.generate.doc import markdown
from wirebond.protocol import loads, protocol_hash
from wirebond.protocol.model import End, Protocol, Subject
from wirebond.protocol.model.forms import Choice as FormChoice
from wirebond.protocol.model.forms import complement, some_value
from wirebond.protocol.planning import plan_for
from wirebond.protocol.spelling import condition_text

FORMATS = ROOT / "tests" / "formats"


def crc_modbus(data: bytes) -> bytes:
    register = 0xFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0xA001 if register & 1 else 0)
    return register.to_bytes(2, "little")


def crc_xmodem(data: bytes) -> bytes:
    register = 0
    for byte in data:
        register ^= byte << 8
        for _ in range(8):
            register = (register << 1 ^ (0x1021 if register & 0x8000 else 0)) & 0xFFFF
    return register.to_bytes(2, "big")


def vesc_packet(payload: bytes, start: int | None = None) -> bytes:
    """As packet_send_packet of the controller's firmware makes it."""
    start = start or (2 if len(payload) <= 255 else 3)
    return bytes([start]) + len(payload).to_bytes(start - 1, "big") + payload + crc_xmodem(payload) + b"\x03"


def found_by_all(model: Protocol, end: End, stream: bytes, folder: Path) -> list[tuple[str, bytes]]:
    """Messages of a stream, which the engine, the generated C++ and the slow decoder must find alike."""
    decoder = Codec(model).decoder(end)
    messages = decoder.feed(stream) + decoder.finish()
    slow = reference.decode(model, stream, end)
    assert [(m.name, m.raw, m.header) for m in messages] == [(f.name, f.wire, f.header) for f in slow.frames]
    assert decoder.stats.as_dict()["discarded_bytes"] == dict(slow.discarded_bytes)
    file = folder / "stream.bin"
    file.write_bytes(stream)
    generated = decode(build_decoder(model, end), file, chunk=3)
    assert [f.wire for f in generated.frames] == [m.raw for m in messages]
    for cause, count in decoder.stats.discarded_bytes.items():
        assert generated.account[f"discarded.{cause}"] == count, cause
    return [(m.name, m.raw) for m in messages]


@pytest.mark.live
def test_the_start_byte_of_a_motor_controller_follows_from_the_size(tmp_path: Path) -> None:
    codec = loaded(FORMATS / "vesc.yaml")
    source = random.Random(1)
    texts = ["".join(source.choices("abcdef", k=size)) for size in (0, 1, 253, 254, 255, 256, 500)]
    frames = [codec.encode("print", text=text) for text in texts]
    assert frames == [vesc_packet(b"\x15" + text.encode()) for text in texts]
    assert [frame[0] for frame in frames] == [2, 2, 2, 2, 3, 3, 3]
    assert found_by_all(codec.model, End.MCU, b"".join(frames), tmp_path) == [("print", frame) for frame in frames]
    assert codec.encode("set_current", current=-1.5) == vesc_packet(b"\x06" + (-1500).to_bytes(4, "big", signed=True))
    calls = [
        f'[&] {{ Terminal m{{}}; static_cast<void>(m.command.assign("{"x" * size}", {size})); '
        "return encode(m, out, sizeof out, size); }()"
        for size in (10, 254, 255, 500)
    ]
    assert printed_by_cpp(codec.model, calls, tmp_path) == [
        vesc_packet(b"\x14" + b"x" * size).hex() for size in (10, 254, 255, 500)
    ]


@pytest.mark.live
def test_a_frame_whose_size_breaks_the_condition_is_refused(tmp_path: Path) -> None:
    codec = loaded(FORMATS / "vesc.yaml")
    short, good = vesc_packet(b"\x15abc", start=3), codec.encode("print", text="good")
    assert found_by_all(codec.model, End.MCU, short + good, tmp_path) == [("print", good)]
    first = explain(codec.model, short + good, End.MCU).stretches[0]
    assert first.kind == Kind.REFUSED
    assert "payload size: expected size in 255..65535, found 3" in first.summary


@pytest.mark.live
def test_a_drone_s_three_direction_bytes(tmp_path: Path) -> None:
    codec = loaded(FORMATS / "msp.yaml")
    assert codec.encode("get_attitude") == bytes.fromhex("24 4D 3C 00 6C 6C")
    good = codec.encode("attitude", roll=1.5, pitch=-2.0, heading=90)
    assert good == bytes.fromhex("24 4D 3E 06 6C 0F 00 EC FF 5A 00") + bytes([0x06 ^ 0x6C ^ 0x0F ^ 0xEC ^ 0xFF ^ 0x5A])
    error = bytes.fromhex("24 4D 21 00 6C 6C")
    assert found_by_all(codec.model, End.MCU, good + error, tmp_path) == [("attitude", good), ("unknown", error)]
    messages = codec.decoder("mcu").feed(good + error)
    assert [m.header for m in messages] == [{"magic": 0x244D3E}, {"magic": 0x244D21}]
    refusal = codec.encode("attitude", roll=0, pitch=0, heading=0, header={"magic": 0x244D21})
    assert refusal.startswith(b"$M!\x06\x6c")
    with pytest.raises(MessageError, match="no form of the frame"):
        codec.encode("get_attitude", header={"magic": 0x244D21})


@pytest.mark.live
def test_the_second_version_of_the_drone_protocol(tmp_path: Path) -> None:
    codec = loaded(FORMATS / "msp2.yaml")
    hello = codec.encode("hello", text="Hello flying world", header={"flag": 0xA5})
    assert hello.hex() == "24583ca5424212004" + "8656c6c6f20666c79696e6720776f726c6482"
    assert found_by_all(codec.model, End.HOST, hello, tmp_path) == [("hello", hello)]


@pytest.mark.live
def test_ranges_bits_and_sizes_choose_the_parts_at_both_ends(tmp_path: Path) -> None:
    codec = loaded(FORMATS / "conditions.yaml")
    frames = []
    for kind in (0, 1, 2, 4, 5, 9, 10, 255):
        for name, number in (("ask", 1), ("stop", 0x80)):
            for size in (0, 4, 5, 8):
                given = {"kind": kind, **({"hop": 7} if kind in (1, 5, 6, 7, 8, 9) and name == "ask" else {})}
                data = bytes(range(size))
                frame = codec.encode(name, data=data, header=given)
                hop = b"\x07" if "hop" in given else b""
                body = bytes([0xC5, kind, 0, 0, size, 0, number]) + hop + bytes(size > 4) + data
                assert frame == body + crc_modbus(body), (kind, name, size)
                frames.append((name, frame))
    stream = b"".join(frame for _, frame in frames)
    assert found_by_all(codec.model, End.HOST, stream, tmp_path) == frames
    with pytest.raises(MessageError, match="no form of the frame"):
        codec.encode("stop", data=b"", header={"kind": 1, "hop": 7})
    calls = ["encode(Ask{}, out, sizeof out, size)"]
    assert printed_by_cpp(codec.model, calls, tmp_path) == [codec.encode("ask", data=b"").hex()]


@pytest.mark.live
def test_parts_that_only_one_end_sends(tmp_path: Path) -> None:
    codec = loaded(FORMATS / "by_sender.yaml")
    assert codec.encode("get", index=3)[:5] == bytes.fromhex("A0 01 01 01 03")
    good = codec.encode("value", value=0)
    busy = codec.encode("value", value=0, header={"state": "busy", "detail": 9})
    assert good[:5] == bytes.fromhex("A0 02 04 01 00")
    assert busy[:6] == bytes.fromhex("A0 02 04 01 01 09")
    assert [codec.encode("beat", sender=end)[1] for end in ("host", "mcu")] == [1, 2]
    assert found_by_all(codec.model, End.MCU, good + busy, tmp_path) == [("value", good), ("value", busy)]
    (message,) = codec.decoder("mcu").feed(busy)
    assert message.header == {"state": "busy", "detail": 9}
    with pytest.raises(MessageError, match="no form of the frame"):
        codec.encode("value", value=0, header={"detail": 9})


def test_whose_bytes_these_are_must_be_said_where_the_ends_frames_look_alike() -> None:
    model = protocol(
        "either",
        f"magic: 0xA0, length: u8, id: u8, {{reserved: 1, when: sender == mcu}}, payload: by_length, {CRC}",
        "{get: {id: 1, sender: host}, value: {id: 2, sender: mcu}}",
    )
    with pytest.raises(UsageError, match="say whose bytes these are: sender='mcu' or sender='host'"):
        Codec(model).decoder()
    assert len(Codec(model).encode("value")) == len(Codec(model).encode("get")) + 1


@pytest.mark.live
def test_with_rest_a_size_only_chooses_what_is_sent(tmp_path: Path) -> None:
    """Both marks are taken with any size; senders use the second one for long payloads."""
    model = protocol(
        "by_rest",
        "{delimiter: 0x00}, {cobs: [{constant: 0x01, when: size <= 2}, {constant: 0x02, when: size > 2}, id: u8, "
        "payload: rest, check: crc-16/ibm-sdlc]}, {delimiter: 0x00}",
        "{m: {id: 1, sender: host, fields: {data: {type: bytes, max: 8}}}}",
    )
    codec = Codec(model)
    frames = [codec.encode("m", data=bytes(n)) for n in (0, 2, 3, 8)]
    assert [codec.decoder("host").feed(frame)[0].name for frame in frames] == ["m"] * 4
    assert found_by_all(model, End.HOST, b"".join(frames), tmp_path) == [("m", frame) for frame in frames]
    other = protocol(
        "only_mark",
        "{delimiter: 0x00}, {cobs: [constant: 0x02, id: u8, payload: rest, check: crc-16/ibm-sdlc]}, {delimiter: 0x00}",
        "{m: {id: 1, sender: host, fields: {data: {type: bytes, max: 8}}}}",
    )
    short = Codec(other).encode("m", data=b"\x05")
    assert found_by_all(model, End.HOST, short, tmp_path) == [("m", short)]


@pytest.mark.live
def test_a_size_counts_before_zeros_are_trimmed(tmp_path: Path) -> None:
    model = protocol(
        "trimmed",
        "{magic: 0xA1, when: size <= 4}, {magic: 0xA2, when: size > 4}, length: u8, id: u8, "
        f"{{payload: by_length, trim_zeros: true}}, {CRC}",
        "{small: {id: 1, sender: host, fields: {a: {type: u32}}}, "
        "large: {id: 2, sender: host, fields: {a: {type: u64}}}}",
    )
    codec = Codec(model)
    frames = [codec.encode("small", a=1), codec.encode("large", a=1)]
    assert [frame[:2] for frame in frames] == [b"\xa1\x01", b"\xa2\x01"]
    swapped = b"\xa1" + frames[1][1:-2]
    swapped += crc_modbus(swapped)
    stream = frames[0] + swapped + frames[1]
    assert found_by_all(model, End.HOST, stream, tmp_path) == [("small", frames[0]), ("large", frames[1])]


@pytest.mark.parametrize("late", [False, True])
def test_a_magic_that_is_asked_for_is_sent_or_refused(late: bool) -> None:
    lengths = "{length: u8, when: magic == 0xA1}, {length: u16, when: magic == 0xA2}"
    codec = Codec(
        protocol(
            "chosen",
            f"magic: {{any: [0xA1, 0xA2]}}, {lengths}, id: u8, payload: by_length, {CRC}",
            "{block: {id: 1, sender: mcu, fields: {data: {type: bytes, max: 400}}}}",
        )
    )
    size = 300 if late else 3
    wanted = codec.encode("block", data=bytes(size), header={"magic": 0xA2})
    assert wanted[0] == 0xA2
    (message,) = codec.decoder("mcu").feed(wanted)
    assert message.header == {"magic": 0xA2}
    if late:
        with pytest.raises(MessageError, match="with this header the frame's length can express at most 255"):
            codec.encode("block", data=bytes(size), header={"magic": 0xA1})
    with pytest.raises(MessageError, match="no form of the frame has the header fields magic"):
        codec.encode("block", data=b"", header={"magic": 0xA3})


@pytest.mark.live
def test_generated_code_sends_the_magic_that_its_header_asks_for(tmp_path: Path) -> None:
    codec = loaded(FORMATS / "msp.yaml")
    header = "Header header{wirebond::End::mcu}; "
    calls = [
        f"[&] {{ {header}{choice}return encode(Attitude{{}}, header, out, sizeof out, size); }}()"
        for choice in ("", "header.magic = 0x244D21; ")
    ]
    values = {"roll": 0, "pitch": 0, "heading": 0}
    assert printed_by_cpp(codec.model, calls, tmp_path) == [
        codec.encode("attitude", values).hex(),
        codec.encode("attitude", values, header={"magic": 0x244D21}).hex(),
    ]


HEAD = (
    "magic: {any: [0xA1, 0xA2]}, length: u16, {field: kind, type: u8, enum: {ping: 1, read: 2}, default: ping}, "
    "{field: flags, type: u16}, id: u8"
)


@pytest.mark.parametrize(
    ("written", "shown"),
    [
        ("flags & 0x01", "flags & 0x01"),
        ("kind == read", "kind == 2"),
        ("kind != 0x02", "kind != 2"),
        ("kind in [ping, 4..7, 5..9]", "kind in [1, 4..9]"),
        ("kind not in 3..5", "kind not in 3..5"),
        ("not (kind in [1, 2] and flags & 0x0300)", "not (kind in 1..2 and flags & 0x300)"),
        ("flags & 0x0F == 3", "flags & 0x0F == 3"),
        ("id > 0x7F and magic == 0xA1", "id in 128..255 and magic == 0xA1"),
        ("size <= 8", "size in 0..8"),
        ("magic in [0xA1, 0xA2] and sender == host", "magic in [0xA1, 0xA2] and sender == host"),
    ],
)
def test_conditions_are_read_and_shown(written: str, shown: str) -> None:
    model = loads(
        f"wirebond: 1\nprotocol: c\nframe: [{HEAD}, {{constant: 0x77, when: '{written}'}}, payload: by_length, {CRC}]\n"
        "messages: {m: {id: 1, sender: host}}\n"
    )
    part = next(part for part in model.format.parts if part.condition is not None)
    assert part.condition is not None
    assert condition_text(part.condition) == shown
    assert shown in markdown(Codec(model))


@pytest.mark.parametrize(
    ("written", "sentence"),
    [
        ("kind ==", "a value is expected at its end"),
        ("kind", "`kind` is compared with nothing"),
        ("kind = 1", "'=' has no meaning here"),
        ("kind == 1 or kind == 2", "`or` is not possible; write a list"),
        ("not kind == 1", r"`not` must be followed by `\(`"),
        ("kind in [1, 2", r"a `\]` is missing"),
        ("(kind == 1", r"a `\)` is missing"),
        ("kind in 7..3", "the range 7..3 is empty; write the smaller bound first"),
        ("kind & 0", "a mask of 0 selects no bit"),
        ("size < 0", "nothing is < 0"),
        ("kinds == 1", "the header has no field `kinds`; did you mean `kind`"),
        ("kind == pong", "`kind` has no value `pong`; did you mean `ping`"),
        ("flags == ping", "`flags` has no named values; write a number"),
        ("kind == 300", "`kind` has 8 bits, and 300 does not fit; the maximum is"),
        ("kind & 0x100", "`kind` has 8 bits; take a lower one"),
        ("flags & 0x0F == 0x10", "0x10 has bits that 0x0F does not select"),
        ("magic == 0xA3", "no magic of this frame has that value"),
        ("magic == 161", "is ambiguous"),
        ("magic in 161..162", "a magic is compared with bytes; write"),
        ("magic & 1", "`magic` has no bits to select"),
        ("sender == robot", "the sender is `host` or `mcu`"),
        ("later == 1", "`later` must be in the header, before the parts that depend on it"),
    ],
)
def test_a_wrong_condition_is_refused_with_a_sentence(written: str, sentence: str) -> None:
    with pytest.raises(ProtocolFileError, match=sentence):
        loads(
            f"wirebond: 1\nprotocol: c\nframe: [{HEAD}, {{constant: 0x77, when: '{written}'}}, "
            f"{{field: later, type: u8}}, payload: by_length, {CRC}]\nmessages: {{m: {{id: 1, sender: host}}}}\n"
        )


@pytest.mark.parametrize(
    ("frame", "sentence"),
    [
        (
            "magic: 0xA1, {reserved: 2, when: size > 4}, length: {type: u8, counts: rest}, id: u8",
            "cannot distinguish a frame with",
        ),
        (
            "{magic: 0xA1, when: size > 4}, {magic: 0xA2, when: size > 6}, length: u8, id: u8",
            "one frame can contain two parts with a magic",
        ),
        ("{magic: 0xA1, when: sender == host}, length: u8, id: u8", "frames of the MCU have no magic"),
        (
            "{magic: 0xA1, when: id == 1}, length: u8, id: u8",
            "`id` must be in the header, before the parts that depend on it",
        ),
        (
            "{magic: 0xA1, when: size > 4}, {magic: 0xA2 0xA3, when: size <= 4}, length: u8, id: u8",
            "the same number of",
        ),
        (
            "magic: 0xA1, length: u8, {reserved: 1, when: id == 3}, {field: x, type: u8}",
            "the frame has no `id` part; add",
        ),
    ],
)
def test_frames_that_no_receiver_could_read_are_refused(frame: str, sentence: str) -> None:
    with pytest.raises(ProtocolFileError, match=sentence):
        protocol("refused", f"{frame}, payload: by_length, {CRC}", "{m: {id: 1, sender: both}}")


@pytest.mark.parametrize("values", ["enum: {a: 0, b: 2}", "range: [0, 2]"])
def test_a_form_that_needs_values_which_its_sender_refuses_is_none(values: str) -> None:
    with pytest.raises(ProtocolFileError, match="no frame of the host carries `m` with 0 payload bytes"):
        protocol(
            "refused",
            f"magic: 0xA1, length: u8, {{field: kind, type: u8, {values}}}, {{id: u8, when: kind >= 3}}, "
            f"payload: by_length, {CRC}",
            "{m: {id: 1, sender: both}}",
        )


def test_a_message_that_the_conditions_leave_no_form_for_is_refused() -> None:
    with pytest.raises(ProtocolFileError, match="no frame of the host carries `m` with 9 payload bytes; let the cond"):
        protocol(
            "refused",
            f"{{magic: 0xA1, when: size <= 8}}, length: u8, id: u8, payload: by_length, {CRC}",
            "{m: {id: 1, sender: both, fields: {data: {type: bytes, size: 9}}}}",
        )


def test_every_id_of_a_message_needs_a_form() -> None:
    frame = f"magic: 0xA1, id: u8, {{length: u8, when: %s}}, payload: by_length, {CRC}"
    for condition, left_out in (("id in [0..0x7F]", 0x80), ("not (id & 0x04)", 0x74), ("id != 0x90", 0x90)):
        sentence = rf"no frame of the MCU carries `m` with 1 payload bytes and the id {left_out} "
        with pytest.raises(ProtocolFileError, match=sentence):
            protocol("refused", frame % f'"{condition}"', "{m: {id: 0x70..0x90, sender: mcu, fields: {x: {type: u8}}}}")
    split = f"magic: 0xA1, id: u8, {{constant: 0x07, when: %s}}, length: u8, payload: by_length, {CRC}"
    for condition in ("id in [0..0x7F]", "not (id & 0x04)", "id != 0x90"):
        protocol("taken", split % f'"{condition}"', "{m: {id: 0x70..0x90, sender: mcu}}")


@pytest.mark.live
def test_the_id_that_is_sent_chooses_the_form(tmp_path: Path) -> None:
    model = protocol(
        "by_id",
        'magic: 0xA1, id: u8, {field: extra, type: u8, default: 7, when: "id in [0x80..0x8F]"}, '
        f"{{constant: 0x09, when: id & 0x04}}, length: u8, payload: by_length, {CRC}",
        "{m: {id: 0x70..0x90, sender: mcu, fields: {x: {type: u8}}}, other: {id: [1, 4], sender: mcu}}",
    )
    codec = Codec(model)
    stream, calls, frames = b"", [], []
    for name, number, head in (
        ("m", 0x70, "A1 70 01"),
        ("m", 0x74, "A1 74 09 01"),
        ("m", 0x80, "A1 80 07 01"),
        ("m", 0x8C, "A1 8C 07 09 01"),
        ("m", 0x90, "A1 90 01"),
        ("other", 1, "A1 01 00"),
        ("other", 4, "A1 04 09 00"),
    ):
        values = {"x": 5} if name == "m" else {}
        frame = codec.encode(name, values, header={"id": number})
        assert frame.startswith(bytes.fromhex(head))
        stream += frame
        frames.append(frame.hex())
        struct = "M{5}" if name == "m" else "Other{}"
        calls.append(f"[&] {{ Header h; h.id = {number}; return encode({struct}, h, out, sizeof out, size); }}()")
    assert [name for name, _ in found_by_all(model, End.MCU, stream, tmp_path)] == ["m"] * 5 + ["other"] * 2
    assert printed_by_cpp(model, calls, tmp_path) == frames
    with pytest.raises(MessageError, match="no form of the frame"):
        codec.encode("m", {"x": 5}, header={"id": 0x70, "extra": 1})


def test_the_unit_of_a_length_is_shown_beside_its_bits() -> None:
    with pytest.raises(ProtocolFileError, match="`counts` belongs to the whole part"):
        protocol(
            "refused",
            "magic: 0xA1, {bits: u16, fields: {id: 6, length: {bits: 10, counts: rest}}}, "
            f"payload: by_length, {CRC}",
            "{m: {id: 1, sender: both}}",
        )


def test_hashes_of_one_bit_and_of_one_magic_stay() -> None:
    """As they were before there were other conditions."""
    model = loaded(FORMATS / "optional.yaml").model
    assert f"0x{protocol_hash(model):016X}" == OPTIONAL_HASH


OPTIONAL_HASH = "0x94EC3C9F03633576"


def test_choices_are_solved_exactly() -> None:
    """Against every number of six bits."""
    source = random.Random(3)
    for _ in range(300):
        choices = []
        for _ in range(source.randint(1, 3)):
            mask = source.randrange(1, 64)
            bounds = sorted(source.sample(range(mask + 1), min(mask + 1, 2)))
            allowed = ((bounds[0], bounds[-1]),)
            choices.append(
                FormChoice(Subject.FIELD, "x", mask, complement(allowed, mask) if source.random() < 0.5 else allowed)
            )
        fitting = {n for n in range(64) if all(choice.holds(n) for choice in choices)}
        found = some_value(tuple(choices), 6)
        assert (found in fitting) if fitting else found is None
        for choice in choices:
            if choice.fixed_bits is not None:
                mask, value = choice.fixed_bits
                assert {n for n in range(64) if n & mask == value} == {n for n in range(64) if choice.holds(n)}


def test_exclusive_conditions_make_no_forms_that_cannot_be() -> None:
    model = loaded(FORMATS / "conditions.yaml").model
    assert len(plan_for(model, End.HOST).forms) == 6
