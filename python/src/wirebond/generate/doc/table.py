"""Markdown tables, nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def table(headers: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Write the lines of a table. A header that begins with `>` aligns its column to the right. Columns without any
    text are left out."""
    cells = [[_cell(text) for text in row] for row in rows]
    kept = [i for i in range(len(headers)) if any(row[i] for row in cells)]
    names = [headers[i].removeprefix(">") for i in kept]
    rules = ["--:" if headers[i].startswith(">") else "---" for i in kept]
    return [_line(names), _line(rules), *(_line([row[i] for i in kept]) for row in cells)]


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;")


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
