"""The protocol's own document in Chinese, block by block. What the protocol file says in its own words stays."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache

from wirebond.chinese import Table
from wirebond.codec import Codec
from wirebond.generate.doc.pages import markdown
from wirebond.protocol.model import Field, Protocol

_FENCE = "```"
_DRAWING = "```text"
_HEAD = re.compile(r"(#+ |- |\d+\. |)(.*)", re.DOTALL)
_CELL = re.compile(r"(?<!\\)\|")
_NAMES = {"field", "part", "message", "name", "service", "then", "unit", "on the wire", "unstuffed"}  # columns


@cache
def _blocks() -> Table:
    return Table("document", "explained")


@cache
def _columns() -> Table:
    return Table("columns")


@cache
def _drawing() -> Table:
    return Table("drawing")


def chinese_document(codec: Codec) -> str:
    """Write the document in Chinese, as `wirebond.generate.doc.markdown` in English."""
    return "\n".join(_Translation(own_words(codec.model)).lines(markdown(codec).split("\n")))


def own_words(protocol: Protocol) -> frozenset[str]:
    """Return all descriptions of a file, as they are in the document."""
    found = {protocol.description, *(message.description for message in protocol.messages)}
    for message in protocol.messages:
        found.update(_descriptions(message.fields))
    for part in protocol.format.parts:
        found.update(_descriptions(() if part.header is None else (part.header.value,)))
    words = {" ".join(text.split()).replace("|", "\\|").replace("<", "&lt;") for text in found if text}
    return frozenset(words | {f"{text}." for text in words} | {text.rstrip(".") for text in words})


def _descriptions(fields: tuple[Field, ...]) -> Iterator[str]:
    for field in fields:
        yield field.description
        yield from _descriptions(field.fields)


class _Translation:
    def __init__(self, own: frozenset[str]) -> None:
        self._own = own

    def lines(self, lines: list[str]) -> Iterator[str]:
        paragraph: list[str] = []
        fence = ""
        columns: list[str] | None = None  # of the table that is read
        for line in lines:
            is_row = line.startswith("|") and not fence
            is_head = re.match(r"#+ |- |\d+\. ", line) is not None
            if paragraph and (not line or line.startswith(_FENCE) or is_row or is_head):
                yield self._block(" ".join(paragraph))
                paragraph = []
            if not is_row:
                columns = None
            if fence or line.startswith(_FENCE):
                yield self._drawn(line) if fence == _DRAWING else line
                fence = "" if fence and line == _FENCE else fence or line
            elif is_row:
                cells = [cell.strip() for cell in _CELL.split(line)[1:-1]]
                yield self._row(cells, columns)
                columns = columns or cells
            elif line:
                paragraph.append(line)
            else:
                yield line

    def _block(self, text: str) -> str:
        found = _HEAD.fullmatch(text)
        assert found is not None, "everything is a head and a rest"
        return found[1] + self._words(found[2])

    def _row(self, cells: list[str], columns: list[str] | None) -> str:
        if columns is None:
            told = [_columns().find(cell) or cell for cell in cells]
        else:
            told = [self._cell(cell, column) for cell, column in zip(cells, columns, strict=True)]
        return f"| {' | '.join(told)} |"

    def _cell(self, cell: str, column: str) -> str:
        is_name = column in _NAMES and not cell.startswith(("[", "**"))
        return cell if is_name else self._words(cell)

    def _words(self, text: str) -> str:
        """Return a sentence, or several; what the file says may come first."""
        if text in self._own:
            return text
        parts = text.split("; ")
        for end in range(len(parts) - 1, 0, -1):
            if (own := "; ".join(parts[:end])) in self._own:
                return f"{own}；{self._words('; '.join(parts[end:]))}"  # noqa: RUF001
        for said in (text, text[:1].lower() + text[1:]):
            if (found := _blocks().find(said)) is not None:
                return found
        return text

    def _drawn(self, line: str) -> str:
        """Translate the words beside the drawing only."""
        found = _drawing().find(line.strip())
        return line if found is None else line.replace(line.strip(), found)
