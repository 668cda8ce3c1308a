"""The protocol's own document: whole, the same each time, and true to the engine."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from markdown_it import MarkdownIt
from tests.shared import loaded

import wirebond
from wirebond.codec import Codec
from wirebond.generate.doc import markdown
from wirebond.protocol import loads

ROOT = Path(__file__).resolve().parents[3]
FILES = sorted([*(ROOT / "protocols").glob("*.yaml"), *(ROOT / "tests" / "formats").glob("*.yaml")])
BY_NAME = pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)


@BY_NAME
def test_the_same_file_gives_the_same_text(path: Path) -> None:
    assert markdown(wirebond.load(path)) == markdown(wirebond.load(path))


@BY_NAME
def test_every_message_field_and_part_is_in_it(path: Path) -> None:
    codec = loaded(path)
    text = markdown(codec)
    for message in codec.model.messages:
        assert f"### Message {message.name}\n" in text
        section = text.split(f"### Message {message.name}\n")[1].split("\n## ")[0].split("\n### ")[0]
        for field in message.fields:
            assert f"| {field.name} |" in section
    for part in codec.model.format.parts:
        assert f"| {part.name} |" in text
    for deadline in codec.model.deadlines:
        assert deadline.then in text.split("## Deadlines")[1]
    assert f"{codec.hash:016x}" in text


def test_a_line_that_echoes_carries_one_direction_at_a_time() -> None:
    text = (ROOT / "protocols" / "diffdrive.yaml").read_text()
    assert "bytes/s in each direction" in markdown(Codec(loads(text)))
    echoes = markdown(Codec(loads(text.replace("{baud: 115200}", "{baud: 115200, echo: true}"))))
    assert "bytes/s in both directions together" in echoes
    assert "hears its own bytes" in echoes


def test_it_says_what_a_sequence_number_counts() -> None:
    head = "wirebond: 1\nprotocol: n\nframe: [magic: 0x55, {sequence: u8}, id: u8, payload: 1, check: xor8]\n"
    head += "messages: {go: {id: 1, sender: host, fields: {x: {type: u8}}}}\n"
    text = markdown(Codec(loads(head)))
    assert "rises by one from frame to frame |" in text
    text = markdown(Codec(loads(head.replace("{sequence: u8}", "{sequence: u8, per: message}"))))
    assert text.count("rises by one from frame to frame of the same message |") == 3  # part, field, example
    run = "{bits: u8, fields: {sequence: {bits: 4, per: message}, hops: 4}}"
    text = markdown(Codec(loads(head.replace("{sequence: u8}", run))))
    assert "of the same message |" in text


def test_a_stop_of_several_messages_is_a_list_in_its_order() -> None:
    text = (ROOT / "protocols" / "diffdrive.yaml").read_text()
    stop = "emergency_stop: {message: velocity, linear: 0, angular: 0}"
    several = text.replace(
        stop, "emergency_stop: [{message: status_query}, {message: velocity, linear: 0, angular: 0}]"
    )
    chapter = markdown(Codec(loads(several))).split("## Emergency stop")[1]
    assert chapter.startswith("\n\nThese messages, in this order:\n\n1. status_query\n2. velocity with ")
    assert "The message velocity with " in markdown(Codec(loads(text)))


@BY_NAME
def test_its_frames_are_what_the_decoder_reads(path: Path) -> None:
    codec = loaded(path)
    sections = re.split(r"\n### Message ", markdown(codec))[1:]
    assert len(sections) == len(codec.model.messages)
    for section, message in zip(sections, codec.model.messages, strict=True):
        frames = re.findall(r"```text\n([0-9A-F ]+)\n```", section)
        assert frames, f"{message.name} has no example"
        sender = "host" if message.sender == "both" else message.sender
        for text in frames:
            decoder = codec.decoder(sender)
            decoder.expect(codec.tables.request_for(message.name))
            decoded = decoder.feed(bytes.fromhex(text)) + decoder.finish()
            assert [m.name for m in decoded] == [message.name]
            assert decoded[0].violations == []


@BY_NAME
def test_it_is_markdown_with_sound_tables_and_links(path: Path) -> None:
    text = markdown(loaded(path))
    tokens = MarkdownIt("commonmark").enable("table").parse(text)
    tables = sum(token.type == "table_open" for token in tokens)
    written = sum(bool(re.fullmatch(r"\|( -+:? \|)+", line)) for line in text.splitlines())
    assert tables == written > 3
    for line, following in zip(text.splitlines(), text.splitlines()[1:], strict=False):
        if line.startswith("|") and following.startswith("|"):
            assert len(re.findall(r"(?<!\\)\|", line)) == len(re.findall(r"(?<!\\)\|", following)), following
    headings = {
        re.sub(r"[^\w -]", "", h).replace(" ", "-").lower() for h in re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    }
    for target in re.findall(r"\]\(#([^)]+)\)", text):
        assert target in headings


def test_the_files_own_examples_come_as_they_are() -> None:
    text = markdown(loaded(ROOT / "protocols" / "diffdrive.yaml"))
    assert "Example, linear = 0.3, angular = 0.5:\n\n```text\nAA 55 01 2C 01 F4 01 00 00 26 0D\n```" in text


def test_wrong_bytes_of_the_files_example_are_named_wrong(tmp_path: Path) -> None:
    file = tmp_path / "own.yaml"
    source = (ROOT / "protocols" / "diffdrive.yaml").read_text()
    file.write_text(source.replace("00 00 00 00 0B 0D", "00 00 00 00 FF 0D"))
    text = markdown(wirebond.load(file))
    assert "AA 55 01 F4 01 00 00 00 00 0B 0D" in text
    assert "gives other bytes for it, which are wrong: `AA 55 01 F4 01 00 00 00 00 FF 0D`" in text


def test_text_of_the_file_cannot_break_a_table(tmp_path: Path) -> None:
    file = tmp_path / "own.yaml"
    source = (ROOT / "protocols" / "diffdrive.yaml").read_text()
    file.write_text(source.replace("description: forwards", 'description: "a | b <script> `x"'))
    assert r"| a \| b &lt;script> `x |" in markdown(wirebond.load(file))


def test_a_log_line_has_its_text_and_level() -> None:
    text = (ROOT / "protocols" / "diffdrive.yaml").read_text(encoding="utf-8")
    logged = text.replace("  status:\n", '  status:\n    log: "battery at {battery} V"\n    level: warning\n', 1)
    section = markdown(Codec(loads(logged))).split("### Message status\n")[1].split("\n### ")[0]
    assert "a log line (warning)" in section
    assert "The host shows it as: `battery at {battery} V`" in section


def test_example_values_leave_out_the_byte_that_ends_a_string_and_agree_with_their_count() -> None:
    codec = Codec(
        loads("""
wirebond: 1
protocol: strings
frame: [magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
messages:
  m:
    id: 1
    sender: host
    fields:
      text:   {type: text, max: 3, ends_with: 0x00}
      word:   {type: text, max: 9, ends_with: 0x77}
      octets: {type: bytes, max: 9, ends_with: 0x02}
      number: {type: u8}
      name:   {type: text, size: number, max: 9}
      list:   {type: u8, count: number, max: 9}
""")
    )
    assert "Example, text = wir, word = ireb, octets = 01 03 04 05, name = wi, list = [" in markdown(codec)


CUT_BY_A_DELIMITER = """
wirebond: 1
protocol: cut
frame: [delimiter: 0x24, id: u8, payload: rest, check: xor8, delimiter: 0x02]
messages:
  free: {id: 1, sender: host, fields: {x: {type: u8}}}
  cut:  {id: 3, sender: host, fields: {x: {type: u8, enum: {dollar: 0x24}}}}
"""


def test_an_example_has_no_delimiter_within_if_that_can_be() -> None:
    sections = markdown(Codec(loads(CUT_BY_A_DELIMITER))).split("### Message ")
    free, cut = (next(s for s in sections if s.startswith(f"{name}\n")) for name in ("free", "cut"))
    assert "24 01" in free
    assert "A receiver does not find this frame" not in free
    assert "A receiver does not find this frame: one of its bytes is a delimiter, which cuts it." in cut
