"""YAML 1.2 text to a tree of values that know their place. Knows YAML, and nothing of protocols.

Built from the parser's events with a stack of its own, so that no input can exhaust Python's. What a file
may cost is bounded by the limits below, aliases included.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    DocumentStartEvent,
    MappingEndEvent,
    MappingStartEvent,
    ScalarEvent,
    SequenceEndEvent,
    SequenceStartEvent,
)

from wirebond.protocol.problems import WHOLE_FILE, Place, Problems, either, quoted

MAX_FILE_BYTES = 256 * 1024  # the parser needs up to 4 s a megabyte; a hundred messages are some 30 kB
MAX_NODES = 20_000
MAX_DEPTH = 32
MAX_NUMBER_LENGTH = 64  # longer digits stay text: no number of a protocol needs them, and big ones cost time


@dataclass(frozen=True)
class Number:
    """A number as written: ``0x55`` and ``85`` are equal values and different texts."""

    text: str
    value: int | float

    def exact(self) -> Fraction:
        """Return the decimal as written, without a float's rounding. Only for finite numbers."""
        if isinstance(self.value, int):
            return Fraction(self.value)
        if self.value == 0:
            return Fraction(0)  # `0e999999999` would be worked out digit by digit
        return Fraction(self.text)


Value = None | bool | Number | str


@dataclass(frozen=True, eq=False)
class Scalar:
    place: Place
    text: str
    value: Value


@dataclass(frozen=True, eq=False)
class Sequence:
    place: Place
    items: list[Node] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Entry:
    key_place: Place
    value: Node


@dataclass(frozen=True, eq=False)
class Mapping:
    place: Place
    entries: dict[str, Entry] = field(default_factory=dict)

    def get(self, key: str) -> Node | None:
        entry = self.entries.get(key)
        return None if entry is None else entry.value

    def key_place(self, key: str) -> Place:
        """Return the place of the key; the mapping's own place if it has no such key."""
        entry = self.entries.get(key)
        return self.place if entry is None else entry.key_place

    def value_place(self, key: str) -> Place:
        """Return the place of the key's value; the mapping's own place if it has no such key."""
        entry = self.entries.get(key)
        return self.place if entry is None else entry.value.place


Node = Scalar | Sequence | Mapping


def read_text(path: str | os.PathLike[str]) -> str:
    """Return the text of a file. Raises ProtocolFileError with one sentence if there is none to be had."""
    problems = Problems(str(path))
    if "\0" in str(path):
        problems.stop(WHOLE_FILE, "a file's name cannot contain a zero byte; check the path")
    try:
        with Path(path).open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except FileNotFoundError:
        problems.stop(WHOLE_FILE, "there is no such file; check the path")
    except IsADirectoryError:
        problems.stop(WHOLE_FILE, _of_folder(Path(path)))
    except PermissionError:
        problems.stop(WHOLE_FILE, "this file may not be read by you; check its permissions")
    except (OSError, ValueError) as error:
        problems.stop(WHOLE_FILE, f"cannot be read: {getattr(error, 'strerror', None) or error}; check the path")
    return decoded(data, str(path))


def decoded(data: bytes, path: str) -> str:
    """Return the text in a file's bytes, of which one more than allowed is enough. Raises as `read_text` does.

    :param path: the name that errors give it.
    """
    problems = Problems(path)
    _validate_size(len(data), problems)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = data[: error.start].decode("utf-8", errors="replace")
        problems.stop(_place_at(before, len(before)), "this is not UTF-8 text; a protocol file is YAML in UTF-8")


def _of_folder(folder: Path) -> str:
    what = "this is a folder, and a protocol file (YAML) is expected"
    try:
        found = sorted(path.name for path in folder.iterdir() if path.suffix in (".yaml", ".yml"))
    except OSError:
        found = []
    if not found:
        return f"{what}; no .yaml file is in it. `wirebond new {folder / 'robot.yaml'}` writes a first one"
    more = f", or another of its {len(found)} .yaml files" if len(found) > 1 else ""
    return f"{what}; name the file in it, such as {folder / found[0]}{more}"


def parse(text: str, problems: Problems) -> Node:
    """Return the tree of a YAML text.

    Problems that leave the rest readable (a repeated key, a tag) are added to ``problems``; others raise
    ProtocolFileError at once.
    """
    text = text.removeprefix("\ufeff")
    _validate_size(len(text.encode("utf-8", errors="surrogatepass")), problems)
    unprintable = _UNPRINTABLE.search(text)
    if unprintable is not None:
        code = f"U+{ord(unprintable.group()):04X}"
        place = _place_at(text, unprintable.start())
        problems.stop(place, f"the character {code} is not allowed in YAML; is this a text file? remove the character")
    builder = _Builder(problems)
    try:
        for event in YAML(typ="safe", pure=True).parse(text):
            builder.take(event)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        if error.context_mark is not None and any(word in (error.problem or "") for word in ("stream", "expected ':'")):
            mark = error.context_mark  # where the bracket was opened, not where the fault was noticed
        place = WHOLE_FILE if mark is None else _place(mark)
        what = " ".join(part for part in (error.context, error.problem) if part)
        if misplaced := _misplaced_line(text, what, place):
            problems.stop(place, misplaced)
        problems.stop(
            place, f"this is not YAML ({_one_line(what)}); {_advice_at(text, what, place, error.context_mark)}"
        )
    except (YAMLError, ValueError) as error:
        problems.stop(WHOLE_FILE, f"this is not YAML ({_one_line(str(error))}); see https://yaml.org/spec/1.2.2")
    if builder.root is None:
        problems.stop(WHOLE_FILE, "the file is empty; a protocol file begins with `wirebond: 1`")
    return builder.root


def plain(node: Node) -> Any:
    """Return the tree as dicts, lists and values, without places. Recursion is safe: MAX_DEPTH bounds it."""
    if isinstance(node, Scalar):
        return node.value
    if isinstance(node, Sequence):
        return [plain(item) for item in node.items]
    return {key: plain(entry.value) for key, entry in node.entries.items()}


_UNPRINTABLE = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]|\ufeff")
_INTEGER = re.compile(r"[-+]?[0-9]+")
_OCTAL = re.compile(r"0o[0-7]+")
_HEX = re.compile(r"0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_INFINITY = re.compile(r"[-+]?(\.inf|\.Inf|\.INF)")
_WORDS: dict[str, Value] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}

# What to do about the parser's commonest complaints: (a part of its text, advice).
_ADVICE = (
    (r"character '\t'", "indent with spaces, not tabs"),
    ("mapping values are not allowed", "put a text that contains `: ` in quotes, or begin a new line"),
    ("expected <block end>", "let lines of one block begin in the same column"),
    ("expected ',' or", "separate with commas, and close every `{` and `[`"),
    ("could not find expected ':'", "write a colon and a space after this key"),
    ("found unexpected end of stream", "close the quotes that open here"),
    ("found character '%'", "put a text that begins with % in quotes"),
    ("found character '@'", "put a text that begins with @ in quotes"),
    ("found character '`'", "put a text that begins with ` in quotes"),
    ("expected the node content", "write a value here, and close every `{` and `[`"),
    ("escape", "write \\\\ for a backslash in double quotes, or use single quotes"),
)


def _advice(what: str) -> str:
    return next((advice for part, advice in _ADVICE if part in what), "check quotes, colons and indentation here")


def _advice_at(text: str, what: str, place: Place, context: Any) -> str:
    """Return the advice for this problem, using the lines there."""
    lines = text.splitlines()
    line = lines[place.line - 1].strip() if 0 < place.line <= len(lines) else ""
    if "expected <block end>" in what and re.match(r"-[A-Za-z_]", line):
        return "write a space after the dash"
    if "expected <block end>" in what and (closed := re.search(r"found '([\]}])'", what)):
        return f"remove this `{closed[1]}`, which closes nothing"
    if "expected ',' or" in what and context is not None:
        opened = _place(context)
        bracket = "{" if "mapping" in what else "["
        return f"separate with commas, and close the `{bracket}` of line {opened.line}, column {opened.column}"
    return _advice(what)


def _misplaced_line(text: str, what: str, place: Place) -> str:
    """Return a sentence where the line begins in a column that it may not have, or the one above has no colon; else
    empty. The parser would say "expected <block end>", or speak of mappings."""
    lines = [one for one in text.splitlines()[: place.line] if one.strip() and not one.lstrip().startswith("#")]
    if len(lines) < 2:
        return ""
    *above, indent = map(_indent, lines)
    if "expected <block end>" in what and place.column == indent + 1 and re.match(r" *[^\s\-\]}]", lines[-1]):
        deeper = [one for one in above if one > indent]
        columns = sorted({*deeper[-1:], *[one for one in above if one < indent][-1:]})
        fitting = either([str(column + 1) for column in columns or above[:1]])
        return (
            f"this line begins in column {place.column}, but no block above begins there; begin it in column {fitting}"
        )
    if "mapping values are not allowed" in what and indent > above[-1]:
        return (
            f"this line is indented further than the one above, which has a value; begin it in column {above[-1] + 1}"
        )
    if "mapping values are not allowed" in what and ":" not in lines[-2]:
        return "the line above has no colon; write `key: value`, with a space after the colon"
    return ""


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip(" "))


def _one_line(text: str) -> str:
    return " ".join(text.split())[:200]


def _place(mark: Any) -> Place:
    return Place(mark.line + 1, mark.column + 1)


def _place_at(text: str, index: int) -> Place:
    before = text[:index]
    return Place(before.count("\n") + 1, index - (before.rfind("\n") + 1) + 1)


def _validate_size(size: int, problems: Problems) -> None:
    if size > MAX_FILE_BYTES:
        limit = MAX_FILE_BYTES // 1024
        problems.stop(
            WHOLE_FILE, f"the file is larger than {limit} KiB; a protocol file is some kilobytes of YAML text"
        )


def value_of(text: str) -> Value:
    """Return a plain scalar by YAML 1.2's core schema: `yes`, `on` and `1_000` are text."""
    if text in _WORDS:
        return _WORDS[text]
    if len(text) > MAX_NUMBER_LENGTH:
        return text
    if _INTEGER.fullmatch(text):
        return Number(text, int(text))
    if _HEX.fullmatch(text):
        return Number(text, int(text, 16))
    if _OCTAL.fullmatch(text):
        return Number(text, int(text, 8))
    if _FLOAT.fullmatch(text):
        return Number(text, float(text))
    if _INFINITY.fullmatch(text):
        return Number(text, float(text.replace(".", "")))
    if text in (".nan", ".NaN", ".NAN"):
        return Number(text, float("nan"))
    return text


@dataclass
class _Open:
    """A list or mapping whose end has not come yet."""

    node: Sequence | Mapping
    anchor: str | None
    key: Scalar | None = None
    key_place: Place = WHOLE_FILE
    awaits_value: bool = False
    nodes: int = 1
    height: int = 1


@dataclass(frozen=True)
class _Anchored:
    node: Node
    nodes: int
    height: int


class _Builder:
    def __init__(self, problems: Problems) -> None:
        self.root: Node | None = None
        self._problems = problems
        self._open: list[_Open] = []
        self._anchors: dict[str, _Anchored | None] = {}  # None: not finished
        self._nodes = 0
        self._documents = 0

    def take(self, event: Any) -> None:
        if isinstance(event, ScalarEvent):
            self._scalar(event)
        elif isinstance(event, (MappingStartEvent, SequenceStartEvent)):
            self._begin(event)
        elif isinstance(event, (MappingEndEvent, SequenceEndEvent)):
            self._end()
        elif isinstance(event, AliasEvent):
            self._alias(event)
        elif isinstance(event, DocumentStartEvent):
            self._document(event)

    def _document(self, event: Any) -> None:
        self._documents += 1
        place = _place(event.start_mark)
        if self._documents > 1:
            self._problems.stop(
                place, "a second YAML document begins here; a file holds one protocol: remove the `---`"
            )
        if event.version is not None and tuple(event.version) != (1, 2):
            self._problems.stop(place, "protocol files are YAML 1.2; remove the `%YAML` line")

    def _scalar(self, event: Any) -> None:
        place = _place(event.start_mark)
        self._refuse_tag(event, place)
        is_plain = event.style in (None, "")
        node = Scalar(place, event.value, value_of(event.value) if is_plain else event.value)
        self._count(1, place)
        if event.anchor is not None:
            self._anchors[event.anchor] = _Anchored(node, 1, 0)
        self._attach(node, place, nodes=1, height=0, may_merge=is_plain)

    def _begin(self, event: Any) -> None:
        place = _place(event.start_mark)
        self._refuse_tag(event, place)
        self._count(1, place)
        if len(self._open) >= MAX_DEPTH:
            self._too_deep(place)
        if event.anchor is not None:
            self._anchors[event.anchor] = None
        node = Mapping(place) if isinstance(event, MappingStartEvent) else Sequence(place)
        self._open.append(_Open(node, event.anchor))

    def _end(self) -> None:
        done = self._open.pop()
        if done.anchor is not None:
            self._anchors[done.anchor] = _Anchored(done.node, done.nodes, done.height)
        self._attach(done.node, done.node.place, nodes=done.nodes, height=done.height)

    def _alias(self, event: Any) -> None:
        place = _place(event.start_mark)
        name = event.anchor
        if name not in self._anchors:
            self._problems.stop(place, f"the alias {quoted('*' + name)} has no anchor before it; write `&{name}` there")
        anchored = self._anchors[name]
        if anchored is None:
            self._problems.stop(
                place, f"the alias {quoted('*' + name)} is inside the block that it repeats; write it out"
            )
        self._count(anchored.nodes, place)
        if len(self._open) + anchored.height > MAX_DEPTH:
            self._too_deep(place)
        self._attach(anchored.node, place, nodes=anchored.nodes, height=anchored.height)

    def _count(self, nodes: int, place: Place) -> None:
        self._nodes += nodes
        if self._nodes > MAX_NODES:
            self._problems.stop(
                place,
                f"the file has more than {MAX_NODES} values, aliases counted as often as used; make it smaller",
            )

    def _too_deep(self, place: Place) -> None:
        self._problems.stop(place, f"nested more than {MAX_DEPTH} deep; a protocol file needs less than ten levels")

    def _refuse_tag(self, event: Any, place: Place) -> None:
        if event.tag is not None:
            self._problems.add(place, f"the tag {quoted(str(event.tag))} is not used in protocol files; remove it")

    def _attach(self, node: Node, place: Place, *, nodes: int, height: int, may_merge: bool = False) -> None:
        if not self._open:
            self.root = node
            return
        parent = self._open[-1]
        parent.nodes += nodes
        parent.height = max(parent.height, height + 1)
        if isinstance(parent.node, Sequence):
            parent.node.items.append(node)
        elif not parent.awaits_value:
            parent.awaits_value = True
            parent.key_place = place
            parent.key = self._key(node, place, may_merge)
        else:
            parent.awaits_value = False
            if parent.key is not None:
                self._put(parent.node, parent.key.text, parent.key_place, node)

    def _key(self, node: Node, place: Place, may_merge: bool) -> Scalar | None:
        if not isinstance(node, Scalar):
            self._problems.add(place, "a list or mapping cannot be a key; a key is one word")
            return None
        if may_merge and node.text == "<<":
            self._problems.add(place, "merge keys (`<<`) are not part of YAML 1.2; write the keys out")
            return None
        return node

    def _put(self, mapping: Mapping, key: str, place: Place, value: Node) -> None:
        first = mapping.entries.get(key)
        if first is None:
            mapping.entries[key] = Entry(place, value)
            return
        before = f"line {first.key_place.line}, column {first.key_place.column}"
        self._problems.add(place, f"the key {quoted(key)} was given before ({before}); keep one of the two")
