"""Stuffings that public formats need: hex digits, a doubled byte that opens a frame alone, and frames that their length
ends. The bytes are those that the makers print; the files in tests/formats name the sources."""

from __future__ import annotations

import random
from collections import Counter
from typing import Any

import pytest

from tests import reference
from tests.cost import calls
from tests.shared import ROOT, loaded
from wirebond import Codec, MessageError, ProtocolFileError
from wirebond.protocol import loads
from wirebond.protocol.model import End, Protocol

NAMES = ("modbus_ascii", "tsip", "xbee_api2", "dynamixel2")


def format_of(name: str) -> Codec:
    return loaded(ROOT / "tests" / "formats" / f"{name}.yaml")


@pytest.mark.parametrize("name", NAMES)
def test_examples_printed_by_the_maker_are_sent_and_understood(name: str) -> None:
    codec = format_of(name)
    assert codec.model.examples
    for example in codec.model.examples:
        values = {key: bytes.fromhex(v) if isinstance(v, str) and key == "data" else v for key, v in example.values}
        assert codec.encode(example.message, values) == example.frame
        decoder = codec.decoder(example.sender)
        messages = decoder.feed(example.frame) + decoder.finish()
        assert [m.name for m in messages] == [example.message]
        assert decoder.stats.frame_bytes == len(example.frame)


def arrivals(codec: Codec, stream: bytes, sender: str, step: int) -> tuple[list[bytes], dict[str, Any]]:
    decoder = codec.decoder(sender)
    found = [m for at in range(0, len(stream), step) for m in decoder.feed(stream[at : at + step])]
    found += decoder.finish()
    return [m.raw for m in found], decoder.stats.as_dict()


def agree(model: Protocol, stream: bytes, sender: End) -> None:
    """The engine, whatever the chunks, and the slow decoder."""
    codec = Codec(model)
    frames, stats = arrivals(codec, stream, sender, len(stream) or 1)
    for step in (1, 2, 3, 7):
        assert arrivals(codec, stream, sender, step) == (frames, stats)
    slow = reference.decode(model, stream, sender)
    assert [frame.wire for frame in slow.frames] == frames
    assert dict(slow.discarded_bytes) == {k: v for k, v in stats["discarded_bytes"].items() if v} or (
        stats["discarded_bytes"] == dict(slow.discarded_bytes)
    )


@pytest.mark.parametrize("name", NAMES)
def test_no_intact_frame_is_lost_between_damaged_ones(name: str) -> None:
    codec = format_of(name)
    host = [m for m in codec.model.messages if m.sent_by(End.HOST)]
    for seed in range(40):
        source = random.Random(f"{name} {seed}")
        stream = bytearray()
        good = []
        for _ in range(8):
            message = source.choice(host)
            values = {f.name: draw(f.name, f.size, source) for f in message.fields}
            frame = codec.encode(message.name, values)
            fate = source.random()
            if fate < 0.2:
                frame = frame[: source.randrange(len(frame))]
            elif fate < 0.4:
                frame = bytearray(frame)
                frame[source.randrange(len(frame))] ^= 1 << source.randrange(8)
            elif fate < 0.6:
                frame += source.randbytes(source.randrange(1, 5))
            else:
                good.append(bytes(frame))
            stream += frame
        agree(codec.model, bytes(stream), End.HOST)
        if name != "tsip":  # which has no check: what is damaged may be another frame
            frames, _ = arrivals(codec, bytes(stream) + bytes(200), "host", 64)
            assert not Counter(good) - Counter(frames)


def draw(name: str, size: int, source: random.Random) -> Any:
    """Values full of what is stuffed."""
    special = b"\xff\xff\xfd\xfd\x7e\x7d\x11\x13\x10\x03"
    if name == "data" and size == 0:
        return bytes(source.choice(special) for _ in range(source.randrange(24)))
    if name == "command":
        return "NJ"
    return int.from_bytes(bytes(source.choice(special) for _ in range(max(size, 1))), "big")


# ---- Dynamixel 2.0: inserted bytes


@pytest.mark.parametrize(
    ("data", "stuffed"),
    [
        ("FF FF FD", "FF FF FD FD"),
        ("FF FF FD FD", "FF FF FD FD FD"),
        ("FF FF FD FF FF FD", "FF FF FD FD FF FF FD FD"),
        ("FF FF FF FD 00", "FF FF FF FD FD 00"),
        ("00 FF FF", "00 FF FF"),
    ],
)
def test_a_byte_is_inserted_after_the_sequence_and_the_length_counts_it(data: str, stuffed: str) -> None:
    codec = format_of("dynamixel2")
    content = bytes.fromhex(data)
    frame = codec.encode("write", {"address": 0x0101, "data": content})
    on_line = bytes.fromhex(stuffed)
    length = (5 + len(on_line)).to_bytes(2, "little")
    assert frame[:-2] == bytes.fromhex("FFFFFD0001") + length + b"\x03\x01\x01" + on_line
    decoder = codec.decoder("host")
    assert [m["data"] for m in decoder.feed(frame)] == [content]


def test_a_header_inside_a_frame_is_not_stuffed_and_its_missing_byte_is_refused() -> None:
    codec = format_of("dynamixel2")
    frame = codec.encode("write", {"address": 0, "data": b"\xff\xff\xfd"})
    decoder = codec.decoder("host")
    decoder.feed(frame.replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd\xfc"))
    decoder.finish()
    assert decoder.stats.rejected_candidates["bad_stuffing"] == 1


# ---- XBee API mode 2


def test_an_escaped_length_ends_the_frame_and_a_start_byte_within_refuses_it() -> None:
    codec = format_of("xbee_api2")
    data = bytes([0x7E, 0x7D, 0x11, 0x13] * 5)  # 0x20 bytes and more: the length 0x0021 needs no escape, 0x0011 does
    frame = codec.encode("received", {"source": 0, "address": 0, "options": 0, "data": data[:5]})
    assert frame[:4] == bytes.fromhex("7E 00 7D 31")  # 0x11 bytes
    assert 0x7E not in frame[1:]
    decoder = codec.decoder("mcu")
    assert [m["data"] for m in decoder.feed(frame)] == [data[:5]]
    cut = codec.decoder("mcu")
    messages = cut.feed(frame[:-3] + frame)
    assert [m["data"] for m in messages] == [data[:5]]
    assert cut.stats.rejected_candidates["bad_stuffing"] == 1
    assert cut.stats.pending_bytes == 0  # the start byte ends the wait, not the silence


# ---- TSIP


def test_a_doubled_byte_is_neither_an_opening_nor_a_closing_delimiter() -> None:
    codec = format_of("tsip")
    values = {"position": 0x10, "velocity": 0x03, "timing": 0x10, "auxiliary": 0x10}
    frame = codec.encode("set_options", values)
    assert frame == bytes.fromhex("10 35 10 10 03 10 10 10 10 10 03")
    decoder = codec.decoder("host")
    messages = decoder.feed(b"\x10\x10" + frame + frame[4:] + frame)
    assert [dict(m.fields) for m in messages if m.name == "set_options"] == [values, values]


# ---- Modbus ASCII


def test_hex_digits_of_either_case_are_understood_and_others_refused() -> None:
    codec = format_of("modbus_ascii")
    frame = codec.encode("read_holding", {"start": 0xABCD, "count": 3}, header={"address": 0xEF})
    assert frame == b":EF03ABCD0003" + b"%02X" % (-(0xEF + 3 + 0xAB + 0xCD + 3) & 0xFF) + b"\r\n"
    decoder = codec.decoder("host")
    assert [m["start"] for m in decoder.feed(frame.lower())] == [0xABCD]
    decoder.feed(frame.replace(b"AB", b"AG"))
    decoder.feed(b":EF0\r\n")
    assert decoder.stats.rejected_candidates["bad_stuffing"] == 2


# ---- what the file may not say

HEAD = "wirebond: 1\nprotocol: p\nframe:\n"
TAIL = "messages:\n  m: {id: 0x10, sender: host, fields: {x: {type: u8}}}\n"


@pytest.mark.parametrize(
    ("frame", "sentence"),
    [
        ("[delimiter: 0x41, hex: [id: u8, payload: rest], delimiter: 0x0A]", "this delimiter is a hex digit"),
        (
            "[delimiter: 0x3A, {hex: [id: u16, payload: rest], first: digit}, delimiter: 0x0A]",
            "this byte is sent as one digit, so it is below 16 in every frame",
        ),
        (
            "[delimiter: 0x3A, {hex: [constant: 0x10, id: u8, payload: rest], first: digit}, delimiter: 0x0A]",
            "this byte is sent as one digit, so it is below 16 in every frame",
        ),
        (
            "[delimiter: 0x10, doubled: [id: u8, payload: rest], delimiter: 0x10 0x03]",
            "the frame of `m` would begin with 0x10 after the delimiter 0x10",
        ),
        (
            "[delimiter: 0x10, doubled: [reserved: 1, id: u8, payload: rest], delimiter: 0x10 0x03]",
            "let it begin with its id or a constant that is neither",
        ),
        (
            "[magic: 0x7E, cobs: [id: u8, payload: by_id]]",
            "stuffing needs a delimiter before and after it",
        ),
        (
            "[length: u8, {escaped: {escape: 0x7D, xor: 0x20, parts: [id: u8, payload: by_length]}}]",
            "without delimiters a stuffed frame begins with its magic",
        ),
        (
            "[magic: 0x7E 0x01, {escaped: {escape: 0x7D, xor: 0x20, parts: [length: u8, id: u8, payload: by_length]}}]",
            "write a magic of one byte",
        ),
        (
            "[magic: 0x7E, {inserted: {after: 0xFF 0x00 0xFF, byte: 1, parts: [id: u8, payload: by_id]}}]",
            "this sequence ends as it begins",
        ),
        (
            "[magic: 0x7E, length: u8, {inserted: {after: 0xFF 0x00, byte: 0x01, parts: [id: u8, payload: by_length, "
            "check: crc-16/modbus]}}]",
            "this check is calculated before stuffing and covers the length",
        ),
        (
            "[delimiter: 0x7E, {inserted: {after: 0xFF 0x00, byte: 0x01, parts: [id: u8, payload: rest]}}, "
            "delimiter: 0x7E]",
            "remove the delimiters",
        ),
    ],
)
def test_the_loader_reports_the_impossible(frame: str, sentence: str) -> None:
    with pytest.raises(ProtocolFileError, match=sentence):
        loads(HEAD.replace("frame:\n", f"frame: {frame}\n") + TAIL)


def test_a_length_too_narrow_for_the_stuffed_bytes_is_refused_by_the_loader() -> None:
    text = HEAD + "  - magic: 0x55\n  - length: u8\n"
    text += "  - inserted: {after: 0x01 0x02, byte: 0x03, parts: [payload: by_length]}\n"
    for size, fits in ((168, True), (200, False)):
        messages = f"messages:\n  m: {{sender: host, fields: {{x: {{type: bytes, size: {size}}}}}}}\n"
        if fits:
            frame = Codec(loads(text + messages)).encode("m", {"x": b"\x01\x02" * (size // 2)})
            assert frame[1] == size + size // 2
        else:
            with pytest.raises((ProtocolFileError, MessageError), match="the frame's length can express"):
                loads(text + messages)


@pytest.mark.parametrize("width", ["u24", "u32"])
def test_a_wide_length_of_stuffed_bytes_loads_at_once(width: str) -> None:
    text = HEAD + f"  - magic: 0x55\n  - length: {width}\n"
    text += "  - inserted: {after: 0x01 0x02, byte: 0x03, parts: [payload: by_length]}\n"
    text += "messages:\n  m: {sender: host, fields: {x: {type: bytes, size: 4}}}\n"
    assert calls(lambda: loads(text)) < 2 * calls(lambda: loads(text.replace(width, "u8")))


@pytest.mark.parametrize(
    "frame",
    [
        "[magic: 0x55, length: u8, escaped: {escape: 0x7D, xor: 0x20, parts: [payload: by_length]}, "
        "check: {type: crc-16/modbus, over: length}]",
        "[magic: 0x55, length: u8, check: crc-8/maxim-dow, inserted: {after: 0x01 0x02, byte: 0x03, "
        "parts: [payload: by_length]}, check: crc-16/modbus]",
    ],
)
def test_a_check_over_a_length_of_stuffed_bytes_covers_what_is_sent(frame: str) -> None:
    messages = "messages:\n  m: {sender: host, fields: {x: {type: bytes, max: 40}}}\n"
    codec = Codec(loads(HEAD.replace("frame:\n", f"frame: {frame}\n") + messages))
    for data in (b"", b"\x01\x02\x7d\x55" * 5, bytes(range(40))):
        sent = codec.encode("m", x=data)
        decoder = codec.decoder("host")
        assert [m.raw for m in decoder.feed(sent) + decoder.finish()] == [sent]
        assert [f.wire for f in reference.decode(codec.model, sent, End.HOST).frames] == [sent]


@pytest.mark.parametrize("stuffing", ["escaped: {escape: 0x7D, xor: 0x20", "inserted: {after: 0x01 0x02, byte: 0x03"])
def test_counts_give_the_size_of_a_stuffed_frame_that_nothing_else_ends(stuffing: str) -> None:
    text = HEAD + f"  - magic: 0x55\n  - {stuffing}, parts: [id: u8, payload: by_id, check: crc-16/modbus]}}\n"
    text += "messages:\n  m:\n    id: 0x81\n    sender: mcu\n"
    text += "    fields: {n: {type: u8}, xs: {type: u8, count: n, max: 9}, k: {type: u16}, "
    text += "ys: {type: u8, count: k, max: 300}}\n"
    codec = Codec(loads(text))
    frames = [codec.encode("m", xs=[1, 2] * n, ys=[0x7D, 0x55, 1, 2] * (20 * n)) for n in range(4)]
    stream = b"".join(frames)
    for size in (1, 3, len(stream)):
        decoder = codec.decoder("mcu")
        found = [m for at in range(0, len(stream), size) for m in decoder.feed(stream[at : at + size])]
        assert [m.raw for m in found] == frames
    assert [f.wire for f in reference.decode(codec.model, stream, End.MCU).frames] == frames
    expected = reference.decode(codec.model, stream[:-1] + stream, End.MCU)
    decoder = codec.decoder("mcu")
    found = decoder.feed(stream[:-1] + stream) + decoder.finish()
    assert [m.raw for m in found] == [f.wire for f in expected.frames]
    assert decoder.stats.as_dict()["discarded_bytes"] == dict(expected.discarded_bytes)
