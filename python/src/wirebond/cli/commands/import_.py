"""``wirebond import``: turns a C header's structs into a first protocol file, with notes on what was left out."""

from __future__ import annotations

from pathlib import Path

from wirebond.cli.output import console, errors, plain, write
from wirebond.errors import UsageError
from wirebond.generate.from_header import import_header
from wirebond.generate.new.write import protocol_name, write_new


def import_structs(header: Path, out: Path | None) -> None:
    if header.is_dir():
        raise UsageError(f"{header} is a folder; name a C header in it")
    imported = import_header(header, protocol_name(out or header))
    for note in imported.notes:
        errors.print(f"left out: {plain(note)}")
    if out is None:
        write(imported.text)
        return
    write_new(out, imported.text)
    count = f"{imported.messages} message{'s' * (imported.messages != 1)}"
    console.print(plain(f"{out}: {count}; its comments list what the header does not say"), soft_wrap=True)
