"""``wirebond doc``: writes the document to a file or to standard output."""

from __future__ import annotations

from pathlib import Path

from wirebond.cli.output import console, plain, write
from wirebond.codec import load
from wirebond.errors import UsageError
from wirebond.generate.doc import chinese_document, markdown
from wirebond.visible import visible
from wirebond.whole_file import write_whole

LANGUAGES = {"en": markdown, "zh": chinese_document}


def write_document(path: Path, out: Path | None, language: str = "en") -> None:
    """Write the document of a protocol file. It replaces an older document, but never the protocol file itself."""
    if language not in LANGUAGES:
        raise UsageError(f"--language is {language}; expected en or zh")
    text = LANGUAGES[language](load(path))
    if out is None:
        write(text)
        return
    if out.is_dir():
        raise UsageError(f"{out} is a folder; --out names a file")
    if out.exists() and out.samefile(path):
        raise UsageError(f"{out} is the protocol file itself; --out names another file")
    write_whole(out, visible(text, keep="\n"))
    console.print(plain(str(out)), soft_wrap=True)
