"""What ``wirebond doc`` does: the document to a file, or to standard output."""

from __future__ import annotations

import sys
from pathlib import Path

from rich.markup import escape

from wirebond.cli.output import console
from wirebond.codec import load
from wirebond.doc import markdown
from wirebond.errors import UsageError


def write_document(path: Path, out: Path | None) -> None:
    """A document is made from its protocol file, so that writing it again may replace it; the file itself never."""
    text = markdown(load(path))
    if out is None:
        sys.stdout.write(text)
        return
    if out.is_dir():
        raise UsageError(f"{out} is a folder; --out names a file")
    if out.exists() and out.samefile(path):
        raise UsageError(f"{out} is the protocol file itself; --out names another file")
    out.write_text(text, encoding="utf-8", newline="\n")
    console.print(escape(str(out)), soft_wrap=True)
