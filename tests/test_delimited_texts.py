"""Texts in frames that are sent as they are between delimiters: no sender writes a text that ends its own frame."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

from wirebond.analysis.explain import explain
from wirebond.codec import Codec
from wirebond.errors import MessageError
from wirebond.generate.code import generate_c, generate_cpp, generate_python
from wirebond.protocol import loads

TEXT = """
wirebond: 1
protocol: lines
frame: [delimiter: 0x24, payload: rest, constant: 0x2A, delimiter: 0x0D 0x0A]
max_payload: 20
messages:
  line:
    sender: both
    fields:
      name: {type: text, size: 4}
      text: {type: text, max: 16}
"""
CODEC = Codec(loads(TEXT))
GOOD = ("plain", "a\nb", "a\rb", "\r", "", "a*b")
ENDING = ("a\r\nb", "\r\n", "a$b", "$")

PROGRAM = """
#include <cstdint>
#include <cstdio>
#include <cstring>
#include "lines.hpp"
bool is_sent(const char* name, const char* text) {
  lines::Line message;
  std::memset(message.name.data(), 0, message.name.size());
  std::memcpy(message.name.data(), name, std::strlen(name));
  message.text.assign(text, std::strlen(text));
  std::uint8_t out[64];
  return write_payload(message, out);
}
int main() {
  for (const char* good : {GOODS}) std::putchar(is_sent("ab", good) ? '1' : '0');
  for (const char* wrong : {WRONGS}) std::putchar(is_sent("ab", wrong) ? '1' : '0');
  std::putchar(is_sent("a$", "b") ? '1' : '0');
}
"""

C_PROGRAM = """
#include <stdio.h>
#include <string.h>
#include "lines.h"
static int is_sent(const char* name, const char* text) {
  lines_line_t message;
  uint8_t out[LINES_LINE_MAX_FRAME_BYTES];
  size_t size = 0;
  lines_init_line(&message);
  memcpy(message.name, name, strlen(name));
  memcpy(message.text.data, text, strlen(text));
  message.text.size = (uint16_t)strlen(text);
  return lines_encode_line(&message, out, sizeof out, &size) == WIREBOND_OK && size > 0;
}
int main(void) {
  static const char* const goods[] = {GOODS};
  static const char* const wrongs[] = {WRONGS};
  size_t i;
  for (i = 0; i < sizeof goods / sizeof *goods; ++i) putchar(is_sent("ab", goods[i]) ? '1' : '0');
  for (i = 0; i < sizeof wrongs / sizeof *wrongs; ++i) putchar(is_sent("ab", wrongs[i]) ? '1' : '0');
  putchar(is_sent("a$", "b") ? '1' : '0');
  return 0;
}
"""

ENDED_PROGRAM = """
#include <stdio.h>
#include <string.h>
#include "ended.h"
static int is_sent(const char* text, uint16_t size) {
  ended_name_t message;
  uint8_t out[ENDED_NAME_MAX_FRAME_BYTES];
  size_t written = 0;
  ended_init_name(&message);
  memcpy(message.name.data, text, size);
  message.name.size = size;
  return ended_encode_name(&message, out, sizeof out, &written) == WIREBOND_OK;
}
static void got(void* context, const ended_name_t* message) {
  (void)context;
  printf("%d %.*s\\n", message->name.size, (int)message->name.size, message->name.data);
}
int main(void) {
  static const struct { size_t size; uint8_t bytes[32]; } frames[] = {FRAMES};
  static ended_from_mcu_t receiver;
  ended_from_mcu_handlers_t handlers;
  size_t i;
  printf("sent %d\\nsent %d\\n", is_sent("abc", 3), is_sent("a\\0c", 3));
  memset(&handlers, 0, sizeof handlers);
  handlers.on_name = got;
  ended_from_mcu_init(&receiver, &handlers);
  for (i = 0; i < sizeof frames / sizeof *frames; ++i) {
    ended_from_mcu_feed(&receiver, frames[i].bytes, frames[i].size, 0);
  }
  printf("broken %d\\n", (int)ended_from_mcu_violations(&receiver).rejected);
  return 0;
}
"""


@pytest.mark.parametrize("text", GOOD)
def test_a_text_without_a_delimiter_comes_back(text: str) -> None:
    [message] = CODEC.decoder("mcu").feed(CODEC.encode("line", {"name": "ab", "text": text}, sender="mcu"))
    assert message.fields == {"name": "ab", "text": text}


@pytest.mark.parametrize("text", ENDING)
def test_python_refuses_a_text_with_a_delimiter(text: str) -> None:
    with pytest.raises(
        MessageError,
        match=r"line.text has at its byte . the bytes that end or begin a frame on the "
        r"wire \(0x",
    ):
        CODEC.encode("line", {"name": "ab", "text": text}, sender="mcu")
    with pytest.raises(MessageError, match=r"line.name "):
        CODEC.encode("line", {"name": "a$", "text": ""}, sender="mcu")


def test_python_refuses_a_zero_in_a_text_that_zeros_pad() -> None:
    for name in ("a\0b", "a\0"):
        with pytest.raises(
            MessageError, match=r"line\.name would end at its byte 1, a zero, with which shorter texts are"
        ):
            CODEC.encode("line", {"name": name, "text": ""}, sender="mcu")


def test_a_typed_module_refuses_it_too(tmp_path: Path) -> None:
    path = tmp_path / "lines.yaml"
    path.write_text(TEXT)
    generate_python(loads(TEXT, str(path)), tmp_path)
    found = importlib.util.spec_from_file_location("lines", tmp_path / "lines.py")
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    sys.modules["lines"] = module
    try:
        found.loader.exec_module(module)
        with pytest.raises(MessageError, match=r"line\.text has at its byte 1"):
            module.Line(name="ab", text="a\r\nb").encode(sender="mcu")
    finally:
        del sys.modules["lines"]


@pytest.mark.live
def test_generated_cpp_refuses_it(tmp_path: Path) -> None:
    generate_cpp(CODEC.model, tmp_path)
    quoted = [", ".join(f'"{t}"' for t in (repr(text)[1:-1] for text in texts)) for texts in (GOOD, ENDING)]
    program = PROGRAM.replace("GOODS", quoted[0]).replace("WRONGS", quoted[1])
    (tmp_path / "main.cpp").write_text(program)
    flags = ["-std=c++17", "-O0", "-Wall", "-Wextra", "-Werror", "-fsanitize=address,undefined"]
    subprocess.run(["g++", *flags, "-I", tmp_path, tmp_path / "main.cpp", "-o", tmp_path / "main"], check=True)
    answers = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True).stdout
    assert answers == "1" * len(GOOD) + "0" * len(ENDING) + "0"


def c_answers(codec: Codec, program: str, folder: Path) -> str:
    """Return the output of a program in C that uses the generated API."""
    generate_c(codec.model, folder)
    (folder / "main.c").write_text(program)
    flags = ["-O0", "-Wall", "-Wextra", "-Werror", "-fsanitize=address,undefined", f"-I{folder}", "-c"]
    made = [folder / "api.o", folder / "main.o"]
    cpp = ["g++", "-std=c++17", "-fno-exceptions", "-fno-rtti"]
    subprocess.run([*cpp, *flags, folder / f"{codec.name}.cpp", "-o", made[0]], check=True)
    subprocess.run(["gcc", "-std=c99", *flags, folder / "main.c", "-o", made[1]], check=True)
    subprocess.run(["gcc", "-fsanitize=address,undefined", *made, "-o", folder / "main"], check=True)
    return subprocess.run([folder / "main"], capture_output=True, text=True, check=True).stdout


@pytest.mark.live
def test_generated_c_refuses_it(tmp_path: Path) -> None:
    quoted = [", ".join(f'"{t}"' for t in (repr(text)[1:-1] for text in texts)) for texts in (GOOD, ENDING)]
    answers = c_answers(CODEC, C_PROGRAM.replace("GOODS", quoted[0]).replace("WRONGS", quoted[1]), tmp_path)
    assert answers == "1" * len(GOOD) + "0" * len(ENDING) + "0"


ENDED = """
wirebond: 1
protocol: ended
frame: [magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
max_payload: 64
messages:
  name: {id: 1, sender: mcu, fields: {FIELD}}
"""


@pytest.mark.live
def test_generated_cpp_and_c_refuse_a_text_with_its_end_and_take_none_without_it(tmp_path: Path) -> None:
    """It is neither handed over without its last byte nor with it: its violation is counted."""
    raw = Codec(loads(ENDED.replace("FIELD", "raw: {type: bytes, max: 64}")))
    codec = Codec(loads(ENDED.replace("FIELD", "name: {type: text, max: 8, ends_with: 0x00}")))
    frames = [
        raw.encode("name", {"raw": sent}) for sent in (b"abc", b"abc\0", b"abcdefgh", b"abcdefgh\0", b"abcdefghi")
    ]
    rows = ", ".join(f"{{{len(frame)}, {{{', '.join(map(str, frame))}}}}}" for frame in frames)
    answers = c_answers(codec, ENDED_PROGRAM.replace("FRAMES", rows), tmp_path)
    assert answers.splitlines() == ["sent 1", "sent 0", "3 abc", "8 abcdefgh", "broken 3"]


def test_a_text_without_its_end_byte_keeps_its_last_byte() -> None:
    raw = Codec(loads(ENDED.replace("FIELD", "raw: {type: bytes, max: 64}")))
    for kind, expected in (("text", "abc"), ("bytes", b"abc")):
        codec = Codec(loads(ENDED.replace("FIELD", f"name: {{type: {kind}, max: 8, ends_with: 0x00}}")))
        frame = raw.encode("name", {"raw": b"abc"})
        [message] = codec.decoder("mcu").feed(frame)
        assert message.fields == {"name": expected}
        assert message.violations == ["name.name does not end with 0x00 within 3 bytes"]
        assert codec.decode_columns(frame, "mcu")["name"]["name"] == [expected]
        [stretch] = explain(codec.model, frame).stretches
        assert any("abc" in str(row.meaning) or "3 bytes" in str(row.meaning) for row in stretch.rows)


def test_texts_that_wirebond_makes_up_have_no_delimiter() -> None:
    text = CODEC.model.message("line").fields[1]
    assert text.excludes == (b"\r\n", b"$")
    assert text.without_ends("a$b\r\nc") == "abc"
