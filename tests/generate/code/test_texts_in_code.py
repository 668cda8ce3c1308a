"""Whatever a file's descriptions and units say, generated code keeps every member and compiles."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import pytest

from wirebond.generate.code import generate_c, generate_cpp
from wirebond.generate.code.cpp_field import comment_text
from wirebond.protocol import loads

pytestmark = pytest.mark.live

Shell = Callable[[list[str]], str]

HARD = (
    "what??/",
    "a\\\\",
    "?\u200b?/",
    "*/ int x;",
    "/* open",
    "??\u2028/",
    "???/",
    "//",
    "\\\\\\n",
    "{{ x }}",
    "%s",
    "??=",
    "-->",
)
LETTERS = "?/*\\\\ ab\u2028\u200b=('!<>-#"


def protocol_text(texts: list[str]) -> str:
    lines = ["wirebond: 1", "protocol: texts", f"description: {quoted(texts[0])}", "frame:", "  - magic: 0xA5"]
    lines += ["  - id: u8", "  - payload: by_id", "  - check: crc-16/mcrf4xx", "messages:"]
    lines += ["  m:", "    id: 1", "    sender: both", f"    description: {quoted(texts[0])}", "    fields:"]
    for number, text in enumerate(texts):
        lines.append(f"      f{number}: {{type: u8, unit: {quoted(text)}, description: {quoted(text)}}}")
    lines.append(f"      e: {{type: u8, description: {quoted(texts[0])}, enum: {{on: 1}}}}")
    lines.append(f"      g: {{type: u8, description: {quoted(texts[0])}, flags: {{hot: 1}}}}")
    return "\n".join(lines) + "\n"


def quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', "") + '"'


def fuzzed(source: random.Random) -> str:
    return "".join(source.choices(LETTERS, k=source.randint(1, 12)))


@pytest.mark.parametrize("seed", range(3))
def test_no_text_swallows_the_line_after_it(seed: int, shell: Shell, tmp_path: Path) -> None:
    source = random.Random(seed)
    texts = [*HARD, *(fuzzed(source) for _ in range(40))]
    protocol = loads(protocol_text(texts))
    generate_cpp(protocol, tmp_path / "cpp")
    generate_c(protocol, tmp_path / "c")
    members = " ".join(f"message.f{number} = 1;" for number in range(len(texts)))
    (tmp_path / "use.c").write_text(
        f'#include "texts.h"\nint main(void) {{ texts_m_t message; {members} message.e = 1; message.g = 1;'
        f" return sizeof message == {len(texts) + 2} ? (message.f0 - 1) : 1; }}\n"
    )
    (tmp_path / "use.cpp").write_text(
        f'#include "texts.hpp"\nint main() {{ texts::M message; {members}'
        f" return sizeof message == {len(texts) + 2} ? (message.f0 - 1) : 1; }}\n"
    )
    warnings = ["-Wall", "-Wextra", "-Werror", "-trigraphs"]
    shell(["gcc", "-std=c99", *warnings, f"-I{tmp_path / 'c'}", str(tmp_path / "use.c"), "-o", str(tmp_path / "in_c")])
    cpp = ["g++", "-std=c++17", *warnings, "-fsyntax-only"]
    shell([*cpp, f"-I{tmp_path / 'cpp'}", str(tmp_path / "use.cpp")])
    shell([*cpp, f"-I{tmp_path / 'c'}", str(tmp_path / "c" / "texts.cpp")])
    shell([str(tmp_path / "in_c")])


@pytest.mark.parametrize(
    ("text", "comment"),
    [
        ("a??/", "a? ?/"),
        ("a???/", "a? ? ?/"),
        ("a*/b", "a* /b"),
        ("a/*b", "a/ *b"),
        ("end\\", "end\\."),
        ("a\nb", "a b"),
    ],
)
def test_a_comment_holds_no_mark_that_ends_or_joins_lines(text: str, comment: str) -> None:
    assert comment_text(text) == comment
