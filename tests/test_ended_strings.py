"""Texts and byte strings that a byte ends: the engine, generated C++, generated C and a slow reader agree."""

from __future__ import annotations

import random
import subprocess
from pathlib import Path
from typing import Any

import pytest

import wirebond
from tests.compilers import CXX
from tests.generate.code.test_python import module_of
from wirebond.analysis.explain import explain
from wirebond.codec import Codec
from wirebond.errors import MessageError
from wirebond.generate.code import generate_c, generate_cpp
from wirebond.protocol import ProtocolFileError, loads

ROOT = Path(__file__).resolve().parents[1]
TEXT = """
wirebond: 1
protocol: ended
frame: [magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
max_payload: 64
messages:
  identity:
    id: 1
    sender: both
    fields:
      count: {type: u8}
      model: {type: text, max: 6, ends_with: 0x00}
      code:  {type: bytes, max: 3, ends_with: 0x2C}
      serial: {type: u16}
      names: {group: {count: count, max: 3, fields: {name: {type: text, max: 4, ends_with: 0x00}, at: {type: u8}}}}
"""
CODEC = Codec(loads(TEXT))
VALUES: dict[str, Any] = {
    "model": "gö2",
    "code": b"\x00\xff",
    "serial": 0x1234,
    "names": [{"name": "", "at": 7}, {"name": "abcd", "at": 0}],
}
PAYLOAD = bytes.fromhex("02 67 c3 b6 32 00 00 ff 2c 34 12 00 07 61 62 63 64 00 00")


RAW = Codec(loads(TEXT.split("      count:", maxsplit=1)[0] + "      raw: {type: bytes, max: 64}\n"))


def framed(payload: bytes) -> bytes:
    """By the engine of a format with the same frame, whose message is bytes alone."""
    return RAW.encode("identity", {"raw": payload})


def slow(payload: bytes) -> dict[str, Any] | None:
    """The fields, read as a manual would say; None where an end is missing or comes too late."""

    def string(most: int, end: int, behind: int) -> bytes | None:
        nonlocal at
        stop = payload.find(bytes([end]), at, len(payload) - behind)
        if stop < 0 or stop - at > most:
            return None
        found, at = payload[at:stop], stop + 1
        return found

    at = 1
    if len(payload) < 5:
        return None
    model = string(6, 0, 3)
    code = None if model is None else string(3, 0x2C, 2)
    if model is None or code is None:
        return None
    serial = int.from_bytes(payload[at : at + 2], "little")
    at += 2
    names = []
    for _ in range(payload[0]):
        name = string(4, 0, 1) if len(payload) - at >= 2 else None
        if name is None:
            return None
        names.append({"name": name.decode(errors="replace"), "at": payload[at]})
        at += 1
    if payload[0] > 3:
        return None
    return {
        "count": payload[0],
        "model": model.decode(errors="replace"),
        "code": code,
        "serial": serial,
        "names": names,
    }


def decoded(payload: bytes) -> Any:
    [message] = CODEC.decoder("mcu").feed(framed(payload))
    return message


def test_each_value_is_followed_by_its_end() -> None:
    assert CODEC.encode("identity", VALUES) == framed(PAYLOAD)
    message = decoded(PAYLOAD)
    assert message.fields == {"count": 2, **VALUES}
    assert not message.violations
    assert slow(PAYLOAD) == message.fields


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"model": "1234567"}, "identity.model has 7 bytes; it holds at most 6"),
        ({"model": "a\0b"}, "identity.model would end at its byte 1"),
        ({"code": b",x"}, "identity.code would end at its byte 0"),
    ],
)
def test_a_value_that_cannot_be_read_again_is_refused(values: dict[str, Any], sentence: str) -> None:
    with pytest.raises(MessageError, match=sentence):
        CODEC.encode("identity", VALUES | values)


@pytest.mark.parametrize(
    ("payload", "sentence"),
    [
        ("00 61 62 63 64 65 66 67 00 2c 34 12", "identity.model does not end with 0x00 within 7 bytes"),
        ("00 61 62 2c 34 12", "identity.model does not end with 0x00 within 2 bytes"),
        ("00 00 61 34 12", "identity.code does not end with 0x2C within 1 byte"),
        ("01 00 2c 34 12 61 62", "identity.names[0].name does not end with 0x00 within 1 byte"),
    ],
)
def test_a_payload_without_the_end_is_delivered_with_its_violation(payload: str, sentence: str) -> None:
    message = decoded(bytes.fromhex(payload))
    assert sentence in message.violations
    [stretch] = explain(CODEC.model, framed(bytes.fromhex(payload))).stretches
    assert any(
        sentence.split("within", maxsplit=1)[0].partition(" does")[2] in str(row.meaning) for row in stretch.rows
    )


@pytest.mark.parametrize(
    ("field", "sentence"),
    [
        ("{type: text, size: 4, ends_with: 0x00}", "a field with `ends_with` has no `size`; write `max: 16`"),
        ("{type: text, ends_with: 0x00}", "a text field needs a size"),
        ("{type: text, max: 4, ends_with: 0xC3}", "bytes from 0x80 on are parts of letters in UTF-8"),
        ("{type: u8, ends_with: 0x00}", "`ends_with` is for text and bytes; remove it"),
        ("{type: text, max: 4, ends_with: 0}", "`0` is ambiguous"),
        ('{type: text, max: 4, ends_with: 0x61, default: "na"}', "`x` would end at its first 0x61"),
    ],
)
def test_a_wrong_file_gets_a_sentence_with_what_to_write(field: str, sentence: str) -> None:
    with pytest.raises(ProtocolFileError, match=sentence.replace("(", r"\(")):
        loads(TEXT.split("      count:", maxsplit=1)[0] + f"      x: {field}\n")


def test_a_frame_without_a_size_cannot_carry_it() -> None:
    with pytest.raises(ProtocolFileError, match="varies in size"):
        loads(TEXT.replace("length: u8, ", "").replace("by_length", "by_id").replace("max_payload: 64\n", ""))


def random_payloads() -> list[bytes]:
    source = random.Random(9)
    found = [PAYLOAD]
    letters = [0, 0, 0x2C, 0x61, 0x62, 1, 2, 3]
    while len(found) < 3000:
        size = source.randint(5, 40)
        found.append(bytes([source.randint(0, 4), *source.choices(letters, k=size - 1)]))
    return found


PROGRAM = """
#include <cstdio>
#include <iostream>
#include <memory>
#include <string>
#include <vector>
#include "ended.hpp"
int main() {
  std::string line;
  while (std::getline(std::cin, line)) {
    std::vector<std::uint8_t> bytes;
    for (std::size_t i = 0; i + 1 < line.size(); i += 2) bytes.push_back(std::stoul(line.substr(i, 2), nullptr, 16));
    const std::unique_ptr<std::uint8_t[]> exact(new std::uint8_t[bytes.size()]);
    std::copy(bytes.begin(), bytes.end(), exact.get());
    ended::Identity message;
    if (!decode(exact.get(), bytes.size(), message)) { std::puts("refused"); continue; }
    std::vector<std::uint8_t> out(payload_bytes(message), 0xEE);
    if (!write_payload(message, out.data())) { std::puts("not written"); continue; }
    for (const std::uint8_t byte : out) std::printf("%02x", byte);
    std::puts("");
  }
  ended::Identity wrong;
  wrong.model.assign("a\\0b", 3);
  std::vector<std::uint8_t> out(payload_bytes(wrong));
  std::puts(write_payload(wrong, out.data()) ? "written" : "refused");
}
"""


@pytest.mark.live
def test_generated_cpp_reads_and_writes_the_same(tmp_path: Path) -> None:
    generate_cpp(CODEC.model, tmp_path)
    (tmp_path / "main.cpp").write_text(PROGRAM)
    flags = ["-std=c++17", "-O0", "-Wall", "-Wextra", "-Werror", "-fsanitize=address,undefined"]
    subprocess.run([CXX, *flags, "-I", tmp_path, tmp_path / "main.cpp", "-o", tmp_path / "main"], check=True)
    payloads = random_payloads()
    lines = "".join(payload.hex() + "\n" for payload in payloads)
    answers = subprocess.run([tmp_path / "main"], input=lines, capture_output=True, text=True, check=True)
    rows = answers.stdout.splitlines()
    assert rows.pop() == "refused"
    good = 0
    for payload, row in zip(payloads, rows, strict=True):
        expected, message = slow(payload), decoded(payload)
        broken = [text for text in message.violations if "UTF-8" not in text]
        assert (expected is None) == bool(broken), (payload.hex(), message.violations)
        if expected is None:
            assert row == "refused", payload.hex()
            continue
        good += 1
        assert message.fields == expected
        assert payload.startswith(bytes.fromhex(row)), payload.hex()
        again = {name: value for name, value in expected.items() if name != "count"}
        assert CODEC.encode("identity", again) == framed(bytes.fromhex(row))
    assert good > 100


def test_c_and_typed_python_have_it(tmp_path: Path) -> None:
    generate_c(CODEC.model, tmp_path)
    assert "struct { uint16_t size; char data[6]; } model;" in (tmp_path / "ended.h").read_text()
    path = tmp_path / "ended.yaml"
    path.write_text(TEXT)
    module = module_of(path, tmp_path)
    found = module.from_message(decoded(PAYLOAD))
    assert (type(found), found.model) == (module.Identity, "gö2")
    assert found.encode() == framed(PAYLOAD)
    assert wirebond.load(path).decode_columns(framed(PAYLOAD), "mcu")["identity"]["model"] == ["gö2"]
