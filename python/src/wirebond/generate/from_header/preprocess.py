"""Processes a C header before its declarations are read: comments, directives, simple macros, attributes.

No preprocessor: headers are not followed, and conditions are decided only where they ask whether a name is defined.
Whoever needs more gives the output of the compiler's own (`cc -E -P header.h`), which passes here unchanged. Every
line keeps its number.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

from wirebond.errors import HeaderFileError, Problem

MAX_FILE_BYTES = 512 * 1024
MAX_TEXT = 4 * 1024 * 1024  # characters after macros were put in
MAX_MACRO_DEPTH = 32

_ADVICE = "run the compiler's preprocessor first: `cc -E -P header.h > plain.h`, and import plain.h"
# Words for "packed" that headers take from their environment.
_PACKED_WORDS = {"__packed", "__PACKED", "PACKED", "__packed__", "_PACKED", "ATTR_PACKED", "__attribute_packed__"}
_DEFINED = {"__GNUC__", "__arm__"}  # for which compilers a header is read here
# Macros that headers take from vendors' compiler headers.
_ENVIRONMENT = {
    "__PACKED_STRUCT": "struct __packed",
    "__PACKED_UNION": "union __packed",
    "static_assert": "_Static_assert",
}
_DROPPED = {"__extension__", "__inline", "__inline__", "__restrict", "__volatile__"}
_TOKEN = re.compile(r'"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'|[A-Za-z_]\w*|\n|[^\S\n]+|.', re.DOTALL)


@dataclass(frozen=True)
class Body:
    """One ``{…}`` of a struct, union or enum, in the order of their opening braces. ``pack``: greatest alignment."""

    line: int
    pack: int | None


@dataclass
class Source:
    """C text that a parser of plain C can read."""

    text: str
    bodies: list[Body] = field(default_factory=list)
    comments: dict[int, str] = field(default_factory=dict)  # by line
    constants: dict[str, int] = field(default_factory=dict)  # macros that are one whole number


def read_header(path: Path) -> str:
    """Read the text of a header.

    :raises HeaderFileError: it is too large, or no text.
    :raises OSError: it cannot be read.
    """
    with path.open("rb") as file:
        data = file.read(MAX_FILE_BYTES + 1)
    if len(data) > MAX_FILE_BYTES:
        stop(path, 0, f"the file is larger than {MAX_FILE_BYTES // 1024} KiB; give the header with the structs alone")
    if b"\0" in data:
        stop(path, 0, "this is not a text file; name a C header")
    return data.decode("utf-8", errors="replace").replace("\r\n", "\n").replace("\r", "\n")


def preprocess(text: str, path: Path) -> Source:
    """Return the text without directives, comments and attributes.

    :raises HeaderFileError: with the line, for what only a real preprocessor can decide.
    """
    plain, comments = _without_comments(text)
    expanded = _Directives(path).run(plain)
    source = _without_attributes(expanded.text, expanded.pack_by_line, path)
    source.comments = comments
    source.constants = expanded.constants
    return source


def stop(path: Path, line: int, sentence: str) -> NoReturn:
    raise HeaderFileError([Problem(str(path), line, 1 if line else 0, sentence)])


def _without_comments(text: str) -> tuple[str, dict[int, str]]:
    """Return the text with blanks for comments, and each line's comment."""
    comments: dict[int, str] = {}
    out: list[str] = []
    line = 1
    pattern = re.compile(
        r'//(?:\\\n|[^\n])*|/\*.*?(?:\*/|\Z)|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'|\n|.', re.DOTALL
    )
    for match in pattern.finditer(text):
        piece = match.group()
        if piece.startswith(("//", "/*")):
            words = re.sub(r"^(//[/!]?<?|/\*[*!]?<?)|\*/$", "", piece)
            words = " ".join(re.sub(r"(?m)^\s*\*", "", words).split())
            if words and "\n" not in piece:
                comments[line] = words
            out.append(re.sub("[^\n]", " ", piece))
        else:
            out.append(piece)
        line += piece.count("\n")
    return "".join(out), comments


@dataclass
class _Expanded:
    text: str
    pack_by_line: dict[int, int | None]
    constants: dict[str, int]


class _Directives:
    def __init__(self, path: Path) -> None:
        self._path = path
        self._macros: dict[str, str | None] = dict.fromkeys(_DEFINED, "1")  # None: with arguments
        self._macros |= _ENVIRONMENT
        self._active: list[tuple[bool, bool]] = []  # for each open condition: is active now, was active before
        self._pack: int | None = None
        self._pack_stack: list[int | None] = []
        self._length = 0

    def run(self, text: str) -> _Expanded:
        out: list[str] = []
        pack_by_line: dict[int, int | None] = {}
        lines = text.split("\n")
        number = 0
        while number < len(lines):
            first = number
            line = lines[number]
            while line.endswith("\\") and number + 1 < len(lines):
                number += 1
                line = line[:-1] + " " + lines[number]
            number += 1
            pack_by_line.update(dict.fromkeys(range(first + 1, number + 1), self._pack))
            stripped = line.strip()
            if stripped.startswith("#"):
                self._directive(stripped[1:].strip(), first + 1)
                line = ""
            elif not all(active for active, _ in self._active):
                line = ""
            else:
                line = self._expand(line, first + 1, 0)
            self._length += len(line) + 1
            if self._length > MAX_TEXT:
                stop(self._path, first + 1, f"the macros make more than {MAX_TEXT} characters; {_ADVICE}")
            out += [line, *[""] * (number - first - 1)]
        if self._active:
            stop(self._path, len(lines), "an `#if` has no `#endif`; add it")
        constants = {name: value for name, body in self._macros.items() if (value := _whole(body)) is not None}
        for name in _DEFINED:
            constants.pop(name, None)
        return _Expanded("\n".join(out), pack_by_line, constants)

    def _directive(self, text: str, line: int) -> None:
        word, _, rest = text.partition(" ") if not text.startswith("if(") else ("if", " ", text[2:])
        rest = rest.strip()
        if word in ("ifdef", "ifndef", "if"):
            value = self._condition(word, rest, line) if all(active for active, _ in self._active) else False
            self._active.append((value, value))
        elif word in ("elif", "else", "endif"):
            self._continue_condition(word, rest, line)
        elif all(active for active, _ in self._active):
            if word == "define":
                self._define(rest, line)
            elif word == "undef":
                self._macros.pop(rest, None)
            elif word == "pragma":
                self._pragma(rest, line)
            elif word == "error":
                stop(self._path, line, f"the header refuses to be read so: {rest}; {_ADVICE}")

    def _condition(self, word: str, rest: str, line: int) -> bool:
        name = re.fullmatch(r"(!?)\s*(?:defined\s*)?\(?\s*([A-Za-z_]\w*)\s*\)?", rest)
        if word in ("ifdef", "ifndef") and name is not None:
            return (name[2] in self._macros) == (word == "ifdef")
        if rest in ("0", "1"):
            return rest == "1"
        if name is not None and "defined" in rest and name[2] != "defined":
            return (name[2] in self._macros) != bool(name[1])
        stop(self._path, line, f"the condition `{rest[:60]}` is not decided here; {_ADVICE}")
        return False

    def _continue_condition(self, word: str, rest: str, line: int) -> None:
        if not self._active:
            stop(self._path, line, f"this `#{word}` has no `#if`; remove it")
        _, before = self._active.pop()
        if word == "endif":
            return
        outer = all(active for active, _ in self._active)
        value = outer and not before and (word == "else" or self._condition("if", rest, line))
        self._active.append((value, before or value))

    def _define(self, rest: str, line: int) -> None:
        match = re.match(r"([A-Za-z_]\w*)(\()?", rest)
        if match is None:
            stop(self._path, line, "this `#define` names nothing; remove it")
            return
        self._macros[match[1]] = None if match[2] else rest[match.end() :].strip()

    def _pragma(self, rest: str, line: int) -> None:
        match = re.fullmatch(r"pack\s*\(([^)]*)\)", rest)
        if match is None:
            return
        for word in (piece.strip() for piece in match[1].split(",")):
            if word == "push":
                self._pack_stack.append(self._pack)
            elif word == "pop":
                self._pack = self._pack_stack.pop() if self._pack_stack else None
            elif word in ("1", "2", "4", "8", "16"):
                self._pack = int(word)
            elif word:
                stop(self._path, line, f"`#pragma pack` with `{word}` is not known here; {_ADVICE}")
        if not match[1].strip():
            self._pack = None

    def _expand(self, line: str, number: int, depth: int) -> str:
        if depth > MAX_MACRO_DEPTH or len(line) > MAX_TEXT // 8:
            stop(self._path, number, f"the macros here go too deep; {_ADVICE}")
        out = []
        changed = False
        for match in _TOKEN.finditer(line):
            word = match.group()
            if word in self._macros and word not in _DEFINED and word not in _PACKED_WORDS:
                body = self._macros[word]
                if body is None and line[match.end() :].lstrip().startswith("("):
                    stop(
                        self._path,
                        number,
                        f"the macro `{word}` takes arguments, which the importer does not support; {_ADVICE}",
                    )
                if body is not None and body != word:
                    out.append(body)
                    changed = True
                    continue
            out.append(word)
        text = "".join(out)
        return self._expand(text, number, depth + 1) if changed else text


def _whole(body: str | None) -> int | None:
    match = re.fullmatch(r"\(?\s*(0[xX][0-9a-fA-F]+|[0-9]+)[uUlL]*\s*\)?", body or "")
    if match is None:
        return None
    digits = match[1]
    return (
        int(digits, 8 if len(digits) > 1 and digits.isdecimal() and digits[0] == "0" else 0) if _valid(digits) else None
    )


def _valid(digits: str) -> bool:
    return len(digits) <= 20 and not (
        len(digits) > 1 and digits[0] == "0" and set(digits) & set("89") and digits.isdecimal()
    )


# ---- attributes ----


def _without_attributes(text: str, pack_by_line: dict[int, int | None], path: Path) -> Source:
    """Replace attributes by blanks. Those that pack structs, unions and enums are noted."""
    tokens = [(match.group(), match.start()) for match in _TOKEN.finditer(text)]
    out: list[str] = []
    bodies: list[Body] = []
    packed: set[int] = set()  # indices of bodies
    open_bodies: list[int | None] = []  # for each open brace its body
    head = False  # after `struct`, before its brace
    head_packed = False
    closed: int | None = None  # the body that was closed last in this declaration
    line = 1
    index = 0
    while index < len(tokens):
        word, _ = tokens[index]
        taken = 1
        if word in _PACKED_WORDS or word in ("__attribute__", "__attribute"):
            taken = 1 if word in _PACKED_WORDS else _extent(tokens, index + 1) + 1
            attribute = "".join(token for token, _ in tokens[index : index + taken])
            if word in _PACKED_WORDS or re.search(r"\b(__)?packed(__)?\b", attribute):
                head_packed = head_packed or head
                if not head and closed is not None:
                    packed.add(closed)
            elif re.search(r"\b(__)?aligned(__)?\b", attribute):
                stop(
                    path,
                    line,
                    "the importer does not support `aligned`; write the padding as fields",
                )
            out.append(re.sub("[^\n]", " ", attribute))
            line += attribute.count("\n")
            index += taken
            continue
        if word in ("struct", "union", "enum"):
            head, head_packed = True, False
        elif word == "{":
            if head:
                bodies.append(Body(line, pack_by_line.get(line)))
                if head_packed:
                    packed.add(len(bodies) - 1)
                open_bodies.append(len(bodies) - 1)
            else:
                open_bodies.append(None)
            head = False
        elif word == "}":
            closed = open_bodies.pop() if open_bodies else None
        elif word in (";", "(", ")", ",", "="):
            head = False
            closed = None if word == ";" else closed
        line += word.count("\n")
        out.append(" " * len(word) if word in _DROPPED else word)
        index += taken
    done = [Body(body.line, 1) if i in packed else body for i, body in enumerate(bodies)]
    return Source("".join(out), done)


def _extent(tokens: list[tuple[str, int]], index: int) -> int:
    """Return how many tokens the bracket at ``index`` has, blanks before it included."""
    depth = 0
    for count in range(1, len(tokens) - index + 1):
        word, _ = tokens[index + count - 1]
        if word == "(":
            depth += 1
        elif word == ")":
            depth -= 1
            if depth == 0:
                return count
        elif depth == 0 and not word.isspace():
            return count - 1
    return len(tokens) - index
