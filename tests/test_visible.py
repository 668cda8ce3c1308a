"""The characters that are escaped, and their escapes."""

from __future__ import annotations

import json

import pytest

from wirebond import LogLine, MessageError
from wirebond.cli.values import to_json
from wirebond.visible import visible, visible_json


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\x00\x07\x1b\x7f", r"\x00\x07\x1b\x7f"),
        ("\x80\x9b\x9f", r"\x80\x9b\x9f"),
        ("a\nb\rc\td", r"a\nb\rc\td"),
        ("\u202e\u2066\u200b\u061c\ufeff\u2028\xad", r"\u202e\u2066\u200b\u061c\ufeff\u2028\xad"),
        ("\U000e0041", r"\U000e0041"),
        ("\udcff\ud800", r"\xff\ud800"),
        ("grün 上位机 🤖 \u00a0 [bold]", "grün 上位机 🤖 \u00a0 [bold]"),
    ],
)
def test_commanding_and_hidden_characters_are_escaped_and_the_rest_stays(text: str, shown: str) -> None:
    assert visible(text) == shown
    assert visible(f"x{text}y") == f"x{shown}y"


def test_line_ends_stay_where_they_are_wanted() -> None:
    assert visible("a\n\x1b\n", keep="\n") == "a\n\\x1b\n"


@pytest.mark.parametrize("code", [*range(0x100), 0x202E, 0xD800, 0xDCFF, 0xFEFF, 0xE0041, 0x1F916])
def test_json_gives_every_character_back(code: int) -> None:
    text = f"a{chr(code)}b"
    written = to_json({"text": text})
    assert json.loads(written) == {"text": text}
    assert visible(written) == written
    assert visible_json(written) == written


def test_texts_for_people_are_safe() -> None:
    assert str(LogLine("info", "\x1b[2J\n")) == r"info: \x1b[2J\n"
    assert str(MessageError("one\n\x1b")) == "one\n\\x1b"
