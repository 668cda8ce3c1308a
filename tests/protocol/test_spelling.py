"""From the model back to a file's words: what is written gives the same part again."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from wirebond.protocol import load, loads, spelling
from wirebond.protocol.model import Part, PartKind, Stuffing
from wirebond.protocol.spelling import field_type, part_text

REST = "wirebond: 1\nprotocol: x\nmessages: {m: {id: 1, sender: host, fields: {a: {type: TYPE}}}}\nframe:\n"


def file_with(parts: list[str], field: str = "u8") -> str:
    return REST.replace("TYPE", field) + "".join(f"  - {part}\n" for part in parts)


@pytest.mark.parametrize(
    "parts",
    [
        ["magic: 0xAA 0x55", "length: u16be", "id: u8", "payload: by_length", "check: crc-16/modbus", "tail: 0x0D"],
        [
            "magic: 0xAA",
            "length: {type: u8, counts: frame, offset: -2}",
            "id: u16",
            "payload: by_length",
            "check: xor8",
        ],
        ["magic: 0xAA", "id: u8", "payload: 4", "reserved: 2", "check: {type: sum16, byte: high, over: id..payload}"],
        ["magic: 0xAA", "id: u8", "payload: by_id", "check: {type: crc-16/kermit, over: payload, byte_order: big}"],
        ["constant: 0x01 0x02", "{id: u8, name: kind}", "payload: by_id", "check: {type: sum16, byte: low}"],
        [
            "magic: 0xAA",
            "id: u8",
            "payload: by_id",
            "check: {type: crc, width: 16, poly: 0x1021, init: 0xffff, refin: true, refout: false, xorout: 0x1}",
        ],
    ],
)
def test_a_part_is_written_as_it_was_read(parts: list[str]) -> None:
    model = loads(file_with(parts)).format.parts
    written = [part_text(model, index) for index in range(len(model))]
    assert loads(file_with(written)).format.parts == model


FORMATS = Path(__file__).resolve().parents[2] / "tests" / "formats"
LITTLE_ENDIAN = [path for path in sorted(FORMATS.glob("*.yaml")) if "byte_order: big\n" not in path.read_text()]


def undescribed(parts: tuple[Part, ...]) -> list[Part]:
    """Without the descriptions of header fields: they are for people, and a part's text leaves them out."""
    return [
        part
        if part.header is None
        else replace(part, header=replace(part.header, value=replace(part.header.value, description="")))
        for part in parts
    ]


@pytest.mark.parametrize("path", LITTLE_ENDIAN, ids=lambda path: path.stem)
def test_parts_of_every_format_are_written_as_they_were_read(path: Path) -> None:
    frame_format = load(path).format
    written = [part_text(frame_format.parts, index) for index in range(len(frame_format.parts))]
    if frame_format.ends_by_silence:
        written.append("silence: 2 ms")
    elif frame_format.delimiter is not None or frame_format.stuffing != Stuffing.NONE:
        return  # what stands around the parts is not a part
    text = path.read_text()
    start = text.index("frame:")
    next_key = re.compile(r"^\w+:", re.MULTILINE).search(text, start + 1)
    assert next_key is not None
    end = next_key.start()
    again = loads(text[:start] + "frame:\n" + "".join(f"  - {part}\n" for part in written) + text[end:])
    assert undescribed(again.format.parts) == undescribed(frame_format.parts)


def test_defaults_are_not_written() -> None:
    model = loads(file_with(["magic: 0xaa", "id: u8", "payload: by_id", "check: {type: xor8, over: magic..payload}"]))
    assert part_text(model.format.parts, 3) == "check: xor8"


def test_every_kind_of_part_can_be_written() -> None:
    assert set(spelling._SPELLINGS) == set(PartKind)


@pytest.mark.parametrize("word", ["u8", "u16", "i24be", "u64", "f32", "f64be", "bool"])
def test_a_field_type_is_written_as_it_was_read(word: str) -> None:
    parts = ["magic: 0xAA", "id: u8", "payload: by_id", "check: xor8"]
    assert field_type(loads(file_with(parts, word)).messages[0].fields[0]) == word
