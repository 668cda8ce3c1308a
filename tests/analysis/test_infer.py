"""A first protocol file from bytes: the formats of public devices, with their files hidden, in captures with noise."""

from __future__ import annotations

import random
from dataclasses import dataclass
from pathlib import Path

import pytest
from tests.shared import PROTOCOLS, loaded

from wirebond.analysis.check import Severity, lint
from wirebond.analysis.identify.formats import without_silence
from wirebond.analysis.infer import Inference, infer
from wirebond.analysis.samples import asked, pool
from wirebond.codec import Codec
from wirebond.protocol import loads
from wirebond.protocol.model import Algorithm, End, PartKind

CONTRIB = sorted((PROTOCOLS / "contrib").glob("*.yaml"))
QUICK = ("crsf", "hdlc", "ibus", "modbus_ascii")
FRAMES = 200
NOISE = 0.01  # part of the bytes that are replaced


@dataclass(frozen=True)
class Capture:
    data: bytes
    codec: Codec
    sender: End


def captured(path: Path, seed: int) -> Capture:
    """Frames of one end with random values, one behind the other, and noise in them."""
    codec = asked(loaded(path))
    source = random.Random(f"{path.stem} {seed}")
    drawn = pool(codec, End.MCU, source.randrange(1 << 30), 60) or pool(codec, End.HOST, source.randrange(1 << 30), 60)
    assert drawn is not None
    data = bytearray(b"".join(source.choices(drawn.frames, k=FRAMES)))
    for at in range(len(data)):
        if source.random() < NOISE:
            data[at] = source.randrange(256)
    return Capture(bytes(data), codec, drawn.sender)


def frames_of(codec: Codec, sender: End, data: bytes) -> set[tuple[int, bytes]]:
    decoder = codec.decoder(sender)
    return {(message.offset, message.raw) for message in (*decoder.feed(data), *decoder.finish())}


def algorithms(codec: Codec) -> set[tuple[int, int, int]]:
    """Return the algorithms of the checks over the payload, as far as frames determine them."""
    found: set[Algorithm] = {
        part.algorithm
        for part in codec.model.format.parts
        if part.kind == PartKind.CHECK and part.algorithm is not None and part.name != "header_check"
    }
    return {(one.width, one.poly, one.xorout) for one in found}


def is_right(capture: Capture, found: Inference | None) -> bool:
    """The frames of the true file come out of the drafted one, and the check is one of the format's."""
    if found is None:
        return False
    model = without_silence(capture.codec.model)  # a capture has no times
    true = frames_of(Codec(model) if model is not None else capture.codec, capture.sender, capture.data)
    drafted = Codec(found.model)
    got = frames_of(drafted, End.MCU, capture.data)
    return len(true & got) >= 0.9 * len(true) and algorithms(drafted) <= algorithms(capture.codec)


@pytest.mark.parametrize("name", QUICK)
def test_the_format_of_a_device_is_found(name: str) -> None:
    capture = captured(PROTOCOLS / "contrib" / f"{name}.yaml", 1)
    found = infer(capture.data)
    assert is_right(capture, found), "nothing" if found is None else found.text
    assert found is not None
    assert lint(Codec(loads(found.text))).number_of(Severity.ERROR) == 0
    assert found.candidate.frames > 0.3 * FRAMES


@pytest.mark.long
def test_most_formats_of_public_devices_are_found() -> None:
    right = {path.stem for path in CONTRIB if is_right(capture := captured(path, 2), infer(capture.data))}
    assert len(right) >= 0.7 * len(CONTRIB), sorted({path.stem for path in CONTRIB} - right)


def test_each_line_has_its_evidence_and_doubts_are_said() -> None:
    text = (
        "wirebond: 1\nprotocol: arm\n"
        "frame: [magic: 0xA5 0x5A, {field: node, type: u8}, sequence: u8, length: u8, id: u8, "
        "payload: by_length, check: {type: crc-16/modbus, over: node..payload}]\nmessages:\n"
        "  a: {id: 1, sender: mcu, fields: {x: {type: u16}}}\n  b: {id: 2, sender: mcu, fields: {x: {type: u32}}}\n"
    )
    codec, source = Codec(loads(text)), random.Random(3)
    data = b"".join(
        codec.encode(
            source.choice("ab"), {"x": source.randrange(1 << 16)}, header={"node": 7, "sequence": number % 256}
        )
        for number in range(120)
    )
    found = infer(data, "arm_draft", "arm.bin", End.MCU)
    assert found is not None
    lines = {line.split("#")[0].strip(): line.partition("# ")[2] for line in found.text.splitlines()}
    assert lines["- magic: 0xA5 0x5A"] == "120 frames begin with it"
    assert lines["- {field: byte_2, type: u8}"] == "always 07"
    assert lines["- {sequence: u8, name: sequence_3}"] == "counts up by one"
    assert lines["- length: u8"] == "leads from each frame to the next, 120 times"
    assert lines["- id: u8"] == "2 values"
    assert lines["- check: {type: crc-16/modbus, over: byte_2..payload, byte_order: little}"].startswith("holds in ")
    assert found.text.startswith("# Drafted from arm.bin by `wirebond infer`.")
    assert "protocol: arm_draft\n" in found.text
    assert any(sentence.startswith("byte 2 never changes here") for sentence in found.draft.uncertain)
    assert found.candidate.frames == 120


def test_a_frame_without_a_check_is_said_to_have_none() -> None:
    source = random.Random(4)
    data = b"".join(b"\x0f" + source.randbytes(22) + b"\xee\x00" for _ in range(150))
    found = infer(data)
    assert found is not None and found.draft.check is None
    assert any(sentence.startswith("no check of the catalogue fits") for sentence in found.draft.uncertain)


@pytest.mark.parametrize(
    "data", [b"", b"\0" * 5000, b"\xff" * 300, bytes(range(256)) * 8, random.Random(1).randbytes(6000)]
)
def test_bytes_without_frames_give_no_file(data: bytes) -> None:
    found = infer(data)
    assert found is None or found.candidate.frame_share > 0.9  # a run of equal blocks is a format of its own
    if data and len(set(data)) > 200 and data[:256] != data[256:512]:
        assert found is None


@pytest.mark.parametrize("values", [b"\0\1", b"\0\1\2\3", b"AB"])
def test_random_bytes_of_a_few_values_give_no_file(values: bytes) -> None:
    """Any short sequence comes often in them, and every other block of a COBS stream is valid."""
    source = random.Random(3)
    assert infer(bytes(source.choice(values) for _ in range(8_000))) is None
