"""The newest values of messages in a terminal: beside the name where they have room, and else below it, all of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

from wirebond.cli.shown import flat_values

_BETWEEN = "  "
_NUMBER = "-0123456789"  # how one begins
_HEADINGS = ("message", "count", "rate", "last values")


@dataclass
class Widths:
    """The widths of a message's values so far, so that they keep their places when they change."""

    _most: dict[str, int] = field(default_factory=dict)

    def padded(self, path: str, texts: Sequence[str]) -> list[str]:
        """Return the texts of one field: numbers flush right, a name flush left, and several names as they are."""
        is_number = all(text[:1] in _NUMBER for text in texts)
        if not is_number and len(texts) > 1:
            return list(texts)
        width = self._most[path] = max(self._most.get(path, 0), *(cell_len(text) for text in texts))
        spaces = [" " * (width - cell_len(text)) for text in texts]
        pairs = zip(spaces, texts, strict=True)
        return [space + text if is_number else text + space for space, text in pairs]


@dataclass(frozen=True)
class Row:
    """A message.

    :ivar values: where it has fields to show.
    :ivar units: of the values that have one, by path.
    :ivar said: shown in place of the values, or before them.
    :ivar wrong: what is wrong with them.
    """

    name: str
    count: str
    rate: str
    values: Mapping[str, Any]
    widths: Widths
    units: Mapping[str, str] = field(default_factory=dict)
    said: Text = field(default_factory=Text)
    wrong: str = ""


class MessageRows:
    """A table of messages. No value is cut: a long one continues in the next line."""

    def __init__(self, rows: Sequence[Row]) -> None:
        self._rows = rows

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        del console
        if not self._rows:
            yield Text("nothing received yet", style="dim")
            return
        rows = [(row.name, row.count, row.rate) for row in self._rows]
        name, count, rate = (max(cell_len(one[at]) for one in (_HEADINGS, *rows)) for at in range(3))
        for at, given in enumerate((_HEADINGS, *rows)):
            head = Text(f"{given[0]:<{name}}{_BETWEEN}{given[1]:>{count}}{_BETWEEN}{given[2]:>{rate}}{_BETWEEN}")
            head.stylize("bold", 0, None if at == 0 else name)
            if at == 0:
                head.no_wrap, head.overflow = True, "ellipsis"
                yield head.append(_HEADINGS[3], "bold")
            else:
                yield from _lines(head, self._rows[at - 1], options.max_width)


def _lines(head: Text, row: Row, width: int) -> Iterator[Text]:
    """Yield a line if all has room in it; else the head, and the values below."""
    fields = [(path, value) for path, value in flat_values(row.values)]
    cells = [Text(_cell(path, value, row)) for path, value in fields]
    cells = [*([row.said] if row.said else []), *cells, *([Text(row.wrong, "red")] if row.wrong else [])]
    whole = Text(_BETWEEN).join(cells)
    if cell_len(head.plain) + cell_len(whole.plain) <= width:
        yield head.append_text(whole)
        return
    yield head
    lists = {path for path, value in fields if isinstance(value, list) and len(value) > 1}
    label = max((cell_len(path) for path in lists), default=0)
    flowing = [cell for cell, (path, _) in zip(cells[bool(row.said) :], fields, strict=False) if path not in lists]
    yield from _flow(_BETWEEN, [*([row.said] if row.said else []), *flowing], _BETWEEN, width)
    for path, value in fields:
        if path in lists:
            elements = [Text(text) for text in row.widths.padded(path, value)]
            elements[-1].append(_unit(path, row))
            yield from _flow(f"{_BETWEEN}{path:<{label}} ", elements, " ", width)
    if row.wrong:
        yield from _flow(_BETWEEN, [Text(word, "red") for word in row.wrong.split(" ")], " ", width)


def _cell(path: str, value: str | list[str], row: Row) -> str:
    if isinstance(value, str):
        return f"{path} {row.widths.padded(path, [value])[0]}{_unit(path, row)}"
    return f"{path} [{' '.join(row.widths.padded(path, value) if value else value)}]{_unit(path, row)}"


def _unit(path: str, row: Row) -> str:
    return f" {row.units[path]}" if path in row.units else ""


def _flow(label: str, cells: Iterable[Text], between: str, width: int) -> Iterator[Text]:
    """Arrange as many as fit after the label, and the rest in further lines below the first. Parts wider than a line
    are broken."""
    line, is_empty = Text(label), True
    for cell in cells:
        if not is_empty and cell_len(line.plain) + len(between) + cell_len(cell.plain) > width:
            yield line
            line, is_empty = Text(" " * cell_len(label)), True
        line = Text.assemble(line, "" if is_empty else between, cell)
        is_empty = False
    if not is_empty:
        line.overflow = "fold"
        yield line
