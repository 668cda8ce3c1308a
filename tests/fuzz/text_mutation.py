"""Changes of a protocol file's text that mostly leave it YAML: lines, words and values of other protocol files."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from functools import cache

from tests.fuzz.files import seed_files

_WORD = re.compile(r"0x[0-9A-Fa-f]+|[A-Za-z_][\w/.-]*|-?\d[\d.]*|[{}\[\],:#&*!|>'\"%@`?-]")
_NUMBERS = [
    "0",
    "1",
    "2",
    "7",
    "8",
    "16",
    "24",
    "64",
    "255",
    "256",
    "1000",
    "65535",
    "65536",
    "-1",
    "0.5",
    "1e400",
    ".nan",
]
_ROUNDS = 4  # changes at most, each time


@cache
def _lines() -> list[str]:
    return sorted({line for path in seed_files() for line in path.read_text(encoding="utf-8").splitlines()})


@cache
def _words() -> list[str]:
    return sorted({word for line in _lines() for word in _WORD.findall(line.split("#")[0])}) + _NUMBERS


def mutated(text: str, source: random.Random) -> str:
    """The text after one to four changes."""
    for _ in range(source.randint(1, _ROUNDS)):
        text = source.choice(_CHANGES)(text, source)
    return text


def _swap_word(text: str, source: random.Random) -> str:
    found = list(_WORD.finditer(text))
    if not found:
        return text
    match = source.choice(found)
    return text[: match.start()] + source.choice(_words()) + text[match.end() :]


def _repeat_word(text: str, source: random.Random) -> str:
    """A word of the same file: names that exist, types that fit."""
    found = list(_WORD.finditer(text))
    if not found:
        return text
    match = source.choice(found)
    return text[: match.start()] + source.choice(found).group() + text[match.end() :]


def _drop_line(text: str, source: random.Random) -> str:
    lines = text.splitlines()
    if lines:
        del lines[source.randrange(len(lines))]
    return "\n".join(lines) + "\n"


def _other_line(text: str, source: random.Random) -> str:
    lines = text.splitlines()
    lines.insert(source.randint(0, len(lines)), source.choice(_lines()))
    return "\n".join(lines) + "\n"


def _indented_line(text: str, source: random.Random) -> str:
    """A line of another file, at the depth of the one that it follows."""
    lines = text.splitlines()
    if not lines:
        return text
    at = source.randrange(len(lines))
    depth = len(lines[at]) - len(lines[at].lstrip())
    lines.insert(at + 1, " " * depth + source.choice(_lines()).lstrip())
    return "\n".join(lines) + "\n"


def _move_line(text: str, source: random.Random) -> str:
    lines = text.splitlines()
    if lines:
        line = lines.pop(source.randrange(len(lines)))
        lines.insert(source.randint(0, len(lines)), line)
    return "\n".join(lines) + "\n"


def _drop_entry(text: str, source: random.Random) -> str:
    """One entry of a flow list or mapping."""
    found = list(re.finditer(r"[{\[,]\s*[^{}\[\],]+(?=[,}\]])", text))
    if not found:
        return text
    match = source.choice(found)
    return text[: match.start() + 1] + text[match.end() :].removeprefix(",")


def _add_entry(text: str, source: random.Random) -> str:
    found = list(re.finditer(r"[,}]", text))
    if not found:
        return text
    at = source.choice(found).start()
    return f"{text[:at]}, {source.choice(_words())}: {source.choice(_words())}{text[at:]}"


def _other_frame(text: str, source: random.Random) -> str:
    """The frame of another file with these messages."""
    other = source.choice(seed_files()).read_text(encoding="utf-8")
    frame = _FRAME.search(other)
    return text if frame is None else _FRAME.sub(lambda _: frame.group(), text, count=1)


_FRAME = re.compile(r"^frame:.*?(?=^\S)", re.MULTILINE | re.DOTALL)
_CHANGES: list[Callable[[str, random.Random], str]] = [
    *(_swap_word, _swap_word, _swap_word, _repeat_word, _repeat_word, _drop_line, _other_line, _indented_line),
    *(_move_line, _drop_entry, _add_entry, _other_frame),
]
