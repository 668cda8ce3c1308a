"""A sender takes a form that can carry the message, or refuses; never one whose length or id would be wrong."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests import reference
from tests.compilers import CC, CXX
from tests.conformance.build import build_decoder, decode
from tests.shared import PROTOCOLS
from wirebond import Codec, MessageError, UsageError, load
from wirebond.analysis.check.holdback import directions
from wirebond.analysis.explain import Kind, explain
from wirebond.errors import ProtocolFileError
from wirebond.generate.code import generate_c, generate_cpp
from wirebond.generate.doc import markdown
from wirebond.protocol import loads, protocol_hash
from wirebond.protocol.model import End, Protocol
from wirebond.sim.virtual_mcu import VirtualMcu

pytestmark = pytest.mark.live

QUICK = ["-O0", "-Wall", "-Wextra", "-Werror"]


def protocol(name: str, frame: str, messages: str) -> Protocol:
    return loads(f"wirebond: 1\nprotocol: {name}\nframe: [{frame}]\nmessages: {messages}\n", f"{name}.yaml")


BLOCK = "{block: {id: 1, sender: mcu, fields: {data: {type: bytes, max: 400}}}}"
CRC = "check: crc-16/modbus"
NARROW_FIRST = "{length: u8, when: magic == 0xA1}, {length: u16, when: magic == 0xA2}"
WIDTHS = protocol("widths", f"magic: {{any: [0xA1, 0xA2]}}, {NARROW_FIRST}, id: u8, payload: by_length, {CRC}", BLOCK)
WORDS = protocol(
    "words",
    "magic: {any: [0xA1, 0xA2]}, {length: {type: u8, counts: frame}, when: magic == 0xA1}, "
    "{length: {type: u8, counts: frame}, when: magic == 0xA2}, {reserved: 9, when: magic == 0xA2}, "
    f"id: u8, payload: by_length, {CRC}",
    "{block: {id: 1, sender: mcu, fields: {data: {type: bytes, max: 250}}}}",
)
BOTH = protocol(
    "both",
    "magic: {host: 0xAA, mcu: 0xBB}, length: u8, id: u8, payload: by_length, check: crc-16/ibm-sdlc",
    "{tell: {id: 1, sender: both, every: 100 ms, fields: {data: {type: u16}}}, "
    "ask: {id: 2, sender: host, reply: tell}}",
)
NO_LENGTH = protocol(
    "no_length",
    f"magic: {{any: [0xA2, 0xA1]}}, {{length: u8, when: magic == 0xA1}}, id: u8, payload: by_length, {CRC}",
    "{move: {id: 1, sender: host, fields: {data: {type: u16}}}, stop: {id: 2, sender: host}}",
)
NO_ID = protocol(
    "no_id",
    f"magic: {{any: [0xA1, 0xA2]}}, length: u8, {{id: u8, when: magic == 0xA2}}, payload: by_length, {CRC}",
    "{move: {id: 1, sender: host, fields: {data: {type: u16}}}, stop: {sender: host, fields: {x: {type: u8}}}, "
    "zero: {id: 0, sender: host, fields: {x: {type: u8}}}}",
)


TWO_IDS = (
    "magic: {any: [0xA1, 0xA2]}, {id: u8, when: magic == 0xA1}, {id: u16, when: magic == 0xA2}, length: u8, "
    f"payload: by_length, {CRC}"
)
ID_MESSAGES = (
    "{near: {id: 0x12, sender: host, fields: {x: {type: u8}}}, far: {id: 0x112, sender: host, "
    "fields: {x: {type: u8}}}, any: {id: 0x20..0xFFF, sender: mcu, fields: {x: {type: u8}}}}"
)
ID_WIDTHS = protocol("id_widths", TWO_IDS, ID_MESSAGES)


def round_trip(codec: Codec, message: str, sender: str, **values: object) -> bytes:
    frame = codec.encode(message, values, sender=sender)
    decoder = codec.decoder(sender)
    (found,) = decoder.feed(frame) + decoder.finish()
    assert (found.name, found.raw) == (message, frame)
    assert {name: found.fields[name] for name in values} == values
    return frame


def run(command: list[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout}{done.stderr}"
    return done.stdout


def printed_by_cpp(model: Protocol, calls: list[str], folder: Path) -> list[str]:
    """Return the generated C++'s result of each call, as hex; the status if it refuses."""
    generate_cpp(model, folder)
    blocks = "\n".join(
        f"  {{ std::size_t size = 0; const wirebond::Status status = {call}; show(status, size); }}" for call in calls
    )
    (folder / "main.cpp").write_text(
        f'#include <cstdio>\n#include <array>\n#include "{model.name}.hpp"\nusing namespace {model.name};\n'
        "static std::uint8_t out[1024];\n"
        "static void show(wirebond::Status status, std::size_t size) {\n"
        '  if (status != wirebond::Status::ok) std::printf("status %d size %d", int(status), int(size));\n'
        '  for (std::size_t i = 0; i < size; ++i) std::printf("%02x", out[i]);\n  std::puts("");\n}\n'
        "int main() {\n" + blocks + "\n}\n"
    )
    run([CXX, "-std=c++17", *QUICK, f"-I{folder}", str(folder / "main.cpp"), "-o", str(folder / "main")])
    return run([str(folder / "main")]).splitlines()


def test_payload_size_chooses_the_form_whose_length_can_hold_it() -> None:
    codec = Codec(WIDTHS)
    for size in (0, 1, 255, 256, 300, 400):
        frame = round_trip(codec, "block", "mcu", data=bytes(size))
        told = b"\xa1" + bytes([size]) if size < 256 else b"\xa2" + size.to_bytes(2, "little")
        assert frame.startswith(told + b"\x01")


def test_generated_code_takes_the_same_forms(tmp_path: Path) -> None:
    codec = Codec(WIDTHS)
    sizes = (0, 1, 255, 256, 300, 400)
    calls = [
        f"[&] {{ Block m{{}}; static const std::uint8_t data[400]{{}}; static_cast<void>(m.data.assign(data, {size})); "
        "return encode(m, out, sizeof out, size); }()"
        for size in sizes
    ]
    assert printed_by_cpp(WIDTHS, calls, tmp_path) == [codec.encode("block", data=bytes(n)).hex() for n in sizes]


def test_generated_code_says_that_the_chosen_form_has_no_room(tmp_path: Path) -> None:
    """The wide form has one byte more than the narrow one."""
    make = "Block m{}; static const std::uint8_t data[400]{}; static_cast<void>(m.data.assign(data, 256)); "
    calls = [f"[&] {{ {make} return encode(m, out, {room}, size); }}()" for room in (256 + 5, 256 + 6)]
    short, exact = printed_by_cpp(WIDTHS, calls, tmp_path)
    assert short.startswith("status") and short.endswith("size 0")
    assert exact == Codec(WIDTHS).encode("block", data=bytes(256)).hex()


def test_a_message_longer_than_every_length_is_refused_when_the_file_is_read() -> None:
    frame = f"magic: {{any: [0xA1, 0xA2]}}, {NARROW_FIRST}, id: u8, payload: by_length, {CRC}".replace("u16", "u8")
    with pytest.raises(ProtocolFileError, match="up to 400 payload bytes; the frame's length can express 255 at most"):
        protocol("narrow", frame, BLOCK)


def test_header_values_that_ask_for_a_narrow_length_are_refused_with_a_sentence() -> None:
    model = protocol(
        "by_header",
        "magic: 0xA1, {field: flags, type: u8, default: 1}, {length: u16, when: flags & 0x01}, id: u8, "
        f"payload: by_length, {CRC}",
        BLOCK,
    )
    codec = Codec(model)
    assert round_trip(codec, "block", "mcu", data=bytes(300)).startswith(b"\xa1\x01\x2c\x01")
    with pytest.raises(MessageError, match="has 300 bytes; with this header the frame's length can express at most 0"):
        codec.encode("block", data=bytes(300), header={"flags": 0})


def test_a_length_does_not_count_the_parts_of_other_forms() -> None:
    """The reserved bytes stand beside one of the two lengths, so a payload of 250 bytes fits the other form."""
    codec = Codec(WORDS)
    assert len(round_trip(codec, "block", "mcu", data=bytes(range(250)))) == 255
    assert WORDS.max_wire_bytes() == 250 + 14  # the larger form, and not the parts of both


@pytest.mark.parametrize(("sender", "magic"), [("host", 0xAA), ("mcu", 0xBB)])
def test_each_end_sends_its_own_magic(sender: str, magic: int) -> None:
    assert round_trip(Codec(BOTH), "tell", sender, data=0x1234)[0] == magic


def test_the_host_is_meant_where_no_sender_is_given() -> None:
    codec = Codec(BOTH)
    assert codec.encode("tell", data=1) == codec.encode("tell", data=1, sender="host")
    with pytest.raises(MessageError, match="ask is sent by the host, not by the mcu"):
        codec.encode("ask", sender="mcu")
    with pytest.raises(UsageError, match="sender is 'robot'; expected 'mcu' or 'host'"):
        codec.encode("tell", data=1, sender="robot")


def test_the_virtual_mcu_speaks_as_the_mcu() -> None:
    codec = Codec(BOTH)
    mcu = VirtualMcu(codec, 0.0)
    decoder = codec.decoder("mcu")
    assert [m.name for m in decoder.feed(mcu.tick(0.0))] == ["tell"]
    assert [m.name for m in decoder.feed(mcu.feed(codec.encode("ask"), 0.01))] == ["tell"]


def test_the_lint_measures_each_direction_with_its_own_frames() -> None:
    assert [found.sender for found in directions(Codec(BOTH), 1)] == [End.HOST, End.MCU]


def test_generated_cpp_asks_whose_frame_is_wanted(tmp_path: Path) -> None:
    calls = [f"encode<From{end}>(Tell{{0x1234}}, out, sizeof out, size)" for end in ("Host", "Mcu")]
    codec = Codec(BOTH)
    assert printed_by_cpp(BOTH, calls, tmp_path) == [
        codec.encode("tell", data=0x1234, sender=sender).hex() for sender in ("host", "mcu")
    ]


def test_generated_c_has_a_function_for_each_end(tmp_path: Path) -> None:
    generate_c(BOTH, tmp_path)
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include "both.h"\nint main(void) {\n  both_tell_t m = {0x1234};\n'
        "  uint8_t out[64]; size_t size = 0;\n"
        "  if (both_encode_tell_from_host(&m, out, sizeof out, &size) != WIREBOND_OK) return 1;\n"
        '  for (size_t i = 0; i < size; ++i) printf("%02x", out[i]);\n  puts("");\n'
        "  if (both_encode_tell_from_mcu(&m, out, sizeof out, &size) != WIREBOND_OK) return 2;\n"
        '  for (size_t i = 0; i < size; ++i) printf("%02x", out[i]);\n  puts("");\n  return 0;\n}\n'
    )
    source, main, program = (str(tmp_path / name) for name in ("both.cpp", "main.o", "main"))
    run([CC, "-std=c99", *QUICK, "-c", str(tmp_path / "main.c"), "-o", main])
    run([CXX, "-std=c++17", *QUICK, f"-I{tmp_path}", source, main, "-o", program])
    codec = Codec(BOTH)
    assert run([program]).split() == [codec.encode("tell", data=0x1234, sender=s).hex() for s in ("host", "mcu")]


def test_a_form_without_the_length_carries_only_an_empty_payload(tmp_path: Path) -> None:
    codec = Codec(NO_LENGTH)
    assert round_trip(codec, "stop", "host")[0] == 0xA2
    assert round_trip(codec, "move", "host", data=3)[0] == 0xA1
    calls = ["encode(Stop{}, out, sizeof out, size)", "encode(Move{3}, out, sizeof out, size)"]
    assert printed_by_cpp(NO_LENGTH, calls, tmp_path) == [
        codec.encode("stop").hex(),
        codec.encode("move", data=3).hex(),
    ]


def test_a_form_without_the_length_is_explained_and_documented() -> None:
    (stretch,) = explain(NO_LENGTH, Codec(NO_LENGTH).encode("stop"), End.HOST).stretches
    assert (stretch.kind, stretch.message) == (Kind.FRAME, "stop")
    assert "none where the length is not there" in markdown(Codec(NO_LENGTH))


def test_id_0_and_no_id_are_two_messages_at_both_ends(tmp_path: Path) -> None:
    """Frames behind 0xA1 have no id. `stop` has none either; `zero` has the id 0."""
    codec = Codec(NO_ID)
    assert round_trip(codec, "move", "host", data=3)[:3] == b"\xa2\x02\x01"
    assert round_trip(codec, "stop", "host", x=3)[:3] == b"\xa1\x01\x03"
    assert round_trip(codec, "zero", "host", x=3)[:3] == b"\xa2\x01\x00"
    calls = [f"encode({m}{{3}}, out, sizeof out, size)" for m in ("Move", "Stop", "Zero")]
    frames = [codec.encode("move", data=3), codec.encode("stop", x=3), codec.encode("zero", x=3)]
    assert printed_by_cpp(NO_ID, calls, tmp_path) == [frame.hex() for frame in frames]
    file = tmp_path / "stream.bin"
    file.write_bytes(b"".join(frames))
    found = decode(build_decoder(NO_ID, End.HOST), file, chunk=1).frames
    assert [frame.message for frame in found] == [0, 1, 2]
    assert [frame.wire for frame in found] == frames
    slow = reference.decode(NO_ID, b"".join(frames), End.HOST)
    assert [frame.name for frame in slow.frames] == ["move", "stop", "zero"]
    (stretch,) = explain(NO_ID, frames[1], End.HOST).stretches
    assert stretch.message == "stop"


def test_the_hash_distinguishes_id_0_from_no_id() -> None:
    text = "{stop: {%ssender: host}}"
    frame = f"magic: {{any: [0xA1, 0xA2]}}, length: u8, {{id: u8, when: magic == 0xA2}}, payload: by_length, {CRC}"
    without, zero = (protocol("optional_id", frame, text % head) for head in ("", "id: 0, "))
    assert protocol_hash(without) != protocol_hash(zero)


def test_an_id_that_no_form_of_the_sender_has_is_refused() -> None:
    model = protocol(
        "by_flag",
        f"magic: 0xA1, length: u8, {{field: flags, type: u8}}, {{id: u8, when: flags & 0x01}}, "
        f"payload: by_length, {CRC}",
        "{move: {id: 1, sender: host, fields: {data: {type: u16}}}, ack: {sender: host}}",
    )
    codec = Codec(model)
    with pytest.raises(MessageError, match="move has the id 1, and a frame with these header values has none; give"):
        codec.encode("move", data=3)
    assert codec.encode("move", data=3, header={"flags": 1})[:4] == bytes.fromhex("A1 02 01 01")
    assert codec.encode("ack")[:3] == bytes.fromhex("A1 00 00")
    with pytest.raises(MessageError, match="ack has no id, and a frame with these header values has one"):
        codec.encode("ack", header={"flags": 1})


@pytest.mark.parametrize(
    ("messages", "sentence"),
    [
        (
            "{a: {sender: mcu}, b: {sender: mcu}}",
            "can carry one message from the MCU, which is `a` .*; give it an id, or",
        ),
        ("{a: {id: 0xFFFFFFFF, sender: mcu}}", "does not fit the frame's id part, whose maximum is 4294967294"),
    ],
)
def test_ambiguous_messages_of_frames_without_an_id_are_refused(messages: str, sentence: str) -> None:
    frame = f"magic: {{any: [0xA1, 0xA2]}}, length: u8, {{id: u32, when: magic == 0xA2}}, payload: by_length, {CRC}"
    with pytest.raises(ProtocolFileError, match=sentence):
        protocol("optional_id", frame, messages)


def test_a_message_of_both_ends_needs_frames_that_both_have_an_id_or_none() -> None:
    frame = f"magic: {{host: 0xA1, mcu: 0xA2}}, length: u8, {{id: u8, when: magic == 0xA2}}, payload: by_length, {CRC}"
    with pytest.raises(ProtocolFileError, match="make it two messages, one for each sender"):
        protocol("one_way_id", frame, "{tell: {sender: both}}")


def test_of_two_forms_that_blame_as_much_the_one_examined_further_is_reported() -> None:
    """The form for long payloads comes first, and its size does not hold; the other one's header check fails."""
    frame = "frame:\n  - magic: 0xA5\n  - length: u8\n  - id: u8\n  - check: {type: crc-8/smbus, over: length..id}\n"
    frame += "  - payload: by_length\n  - {reserved: 2, when: size <= 20}\n"
    messages = "messages: {m: {id: 1, sender: mcu, fields: {x: {type: bytes, max: 40}}}}\n"
    codec = Codec(loads(f"wirebond: 1\nprotocol: p\n{frame}{messages}"))
    for size in (10, 30):
        wrong = bytearray(codec.encode("m", x=bytes(size))[:5])
        wrong[3] ^= 1
        decoder = codec.decoder(End.MCU)
        assert decoder.feed(bytes(wrong)) + decoder.finish() == []
        assert decoder.stats.as_dict()["rejected_candidates"] == {"header_check_mismatch": 1}
        assert dict(reference.decode(codec.model, bytes(wrong), End.MCU).rejected_candidates) == {
            "header_check_mismatch": 1
        }


def test_magics_of_two_lengths_are_refused_with_what_to_do() -> None:
    text = "wirebond: 1\nprotocol: p\nframe: [magic: {host: 0xFF 0xFE, mcu: 0xFF}, payload: 1]\n"
    with pytest.raises(ProtocolFileError, match="the same number of bytes; pad with a `constant` part"):
        loads(text + "messages: {m: {sender: both}}\n")


def test_a_sender_takes_the_first_form_that_has_room_for_the_id() -> None:
    codec = Codec(ID_WIDTHS)
    assert round_trip(codec, "near", "host", x=5).startswith(bytes.fromhex("A1 12 01 05"))
    assert round_trip(codec, "far", "host", x=5).startswith(bytes.fromhex("A2 12 01 01 05"))
    for number, start in ((0x20, "A1 20"), (0xFF, "A1 FF"), (0x100, "A2 00 01"), (0xFFF, "A2 FF 0F")):
        frame = codec.encode("any", x=5, header={"id": number})
        assert frame.startswith(bytes.fromhex(start))
        (found,) = codec.decoder("mcu").feed(frame)
        assert (found.name, found.header["id"]) == ("any", number)
        assert [(f.name, f.wire, f.header["id"]) for f in reference.decode(ID_WIDTHS, frame, End.MCU).frames] == [
            ("any", frame, number)
        ]


def test_an_id_that_the_asked_form_has_no_room_for_is_refused_and_never_cut() -> None:
    codec = Codec(ID_WIDTHS)
    sentence = r"far has the id 274 \(0x112\), and a frame with these header values has room for ids up to 255; give"
    with pytest.raises(MessageError, match=sentence):
        codec.encode("far", x=5, header={"magic": 0xA1})
    with pytest.raises(MessageError, match=r"any has the id 256 \(0x100\), and .* up to 255; give"):
        codec.encode("any", x=5, header={"magic": 0xA1, "id": 0x100})
    assert codec.encode("any", x=5, header={"magic": 0xA1, "id": 0xFF})[:2] == bytes.fromhex("A1 FF")
    assert codec.encode("near", x=5, header={"magic": 0xA2})[:3] == bytes.fromhex("A2 12 00")


def test_generated_code_takes_the_forms_that_have_room_for_the_id(tmp_path: Path) -> None:
    codec = Codec(ID_WIDTHS)
    calls = ["encode(Near{5}, out, sizeof out, size)", "encode(Far{5}, out, sizeof out, size)"]
    expected = [codec.encode("near", x=5).hex(), codec.encode("far", x=5).hex()]
    for number in (0x20, 0xFF, 0x100, 0xFFF):
        calls.append(f"[&] {{ Header h; h.id = {number}; return encode(Any{{5}}, h, out, sizeof out, size); }}()")
        expected.append(codec.encode("any", x=5, header={"id": number}).hex())
    assert printed_by_cpp(ID_WIDTHS, calls, tmp_path) == expected


def test_generated_code_never_cuts_an_id(tmp_path: Path) -> None:
    wide_first = protocol("id_widths_2", TWO_IDS.replace("0xA1, 0xA2]", "0xA2, 0xA1]"), ID_MESSAGES)
    codec = Codec(wide_first)
    with_narrow = "[&] { Header h; h.magic = 0xA1; h.id = %d; return encode(%s{5}, h, out, sizeof out, size); }()"
    calls = [
        with_narrow % (0, "Near"),
        with_narrow % (0, "Far"),
        with_narrow % (0xFF, "Any"),
        with_narrow % (0x100, "Any"),
    ]
    near = codec.encode("near", x=5, header={"magic": 0xA1}).hex()
    one = codec.encode("any", x=5, header={"magic": 0xA1, "id": 0xFF}).hex()
    assert printed_by_cpp(wide_first, calls, tmp_path) == [near, "status 1 size 0", one, "status 1 size 0"]


def test_an_id_that_fits_only_the_other_end_s_frames_is_refused_and_the_widest_counts_in_any_order() -> None:
    frame = (
        "magic: {host: 0xA1, mcu: 0xA2}, {id: u8, when: sender == host}, {id: u16, when: sender == mcu}, "
        f"length: u8, payload: by_length, {CRC}"
    )
    assert protocol("ends", frame, "{far: {id: 0x112, sender: mcu}}").messages[0].id == 0x112
    sentence = r"`far` has the id 274 \(0x112\), and those of the host's frames go up to 255 \(0xFF\); take a smaller"
    with pytest.raises(ProtocolFileError, match=sentence):
        protocol("ends", frame, "{far: {id: 0x112, sender: host}}")
    with pytest.raises(ProtocolFileError, match=r"id 65536 does not fit the frame's id part, whose maximum is 65535"):
        protocol("ends", frame, "{far: {id: 0x10000, sender: mcu}}")
    with pytest.raises(ProtocolFileError, match=r"no frame of the host carries `far` with 0 payload bytes; let the"):
        protocol("match", TWO_IDS, "{far: {id: 0x112, sender: host, match: {magic: 0xA1}}}")
    with pytest.raises(
        ProtocolFileError, match=r"no frame of the host .* with 0 payload bytes and the id 256 \(0x100\)"
    ):
        protocol("match", TWO_IDS, "{far: {id: 0x10..0x112, sender: host, match: {magic: 0xA1}}}")


def test_the_first_version_of_msp_carries_no_id_that_it_has_no_room_for() -> None:
    codec = load(PROTOCOLS / "contrib" / "msp.yaml")
    speed = {"instance": 1, "time": 1.0, "pressure": 2.0, "temperature": 20.0}
    assert codec.encode("set_air_speed", speed)[:6] == bytes.fromhex("24 58 3C 00 03 1F")
    with pytest.raises(MessageError, match=r"set_air_speed has the id 7939 \(0x1F03\), .* room for ids up to 255"):
        codec.encode("set_air_speed", speed, header={"magic": 0x244D3C})
    with pytest.raises(MessageError, match=r"failed has the id 300 \(0x12C\), .* room for ids up to 255"):
        codec.encode("failed", header={"magic": 0x244D21, "id": 300})
    assert codec.encode("failed", header={"magic": 0x244D21, "id": 200})[:5] == bytes.fromhex("24 4D 21 00 C8")
