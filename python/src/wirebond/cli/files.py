"""Commands that write a file: the protocol's document, a first protocol file, an imported one."""

from __future__ import annotations

import sys
from pathlib import Path

from rich.markup import escape

from wirebond.c_header import import_header
from wirebond.cli.output import console, errors
from wirebond.codec import load
from wirebond.datasheet import markdown
from wirebond.errors import UsageError
from wirebond.starter import write_template
from wirebond.starter.write import protocol_name, write_new


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


def write_first_file(path: Path, template: str) -> None:
    write_template(path, template)
    console.print(escape(f"{path}: put your messages in, then run `wirebond check {path}`"), soft_wrap=True)


def import_structs(header: Path, out: Path | None) -> None:
    if header.is_dir():
        raise UsageError(f"{header} is a folder; name a C header in it")
    imported = import_header(header, protocol_name(out or header))
    for note in imported.notes:
        errors.print(f"left out: {escape(note)}")
    if out is None:
        sys.stdout.write(imported.text)
        return
    write_new(out, imported.text)
    count = f"{imported.messages} message{'s' * (imported.messages != 1)}"
    console.print(escape(f"{out}: {count}; its comments say what the header could not tell"), soft_wrap=True)
