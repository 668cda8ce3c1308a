"""Jobs about the text of a protocol file: is it one, its document, the lint, a first one made of a C header."""

from __future__ import annotations

import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any

from wirebond.analysis.check import Places, lint
from wirebond.codec import Codec
from wirebond.errors import HeaderFileError, ProtocolFileError, UsageError
from wirebond.generate.doc import chinese_document, markdown
from wirebond.generate.from_header import import_header
from wirebond.protocol import loads

EDITED = "the edited file"
_KEPT = 4  # results of each kind


@lru_cache(_KEPT)
def codec_of(text: str, name: str = EDITED) -> Codec:
    """Return the codec; the same text is read once.

    :raises ProtocolFileError: the text is not a protocol file.
    """
    return Codec(loads(text, name))


@lru_cache(_KEPT)
def document(text: str, name: str) -> dict[str, Any]:
    """Write the document in Markdown, English and Chinese."""
    codec = codec_of(text, name)
    return {"markdown": markdown(codec), "markdown_zh": chinese_document(codec)}


@lru_cache(_KEPT)
def findings(text: str, name: str) -> dict[str, Any]:
    """Return the findings of the lint."""
    return lint(codec_of(text, name), Places.of_text(text)).as_dict()


def checked(text: str) -> dict[str, Any]:
    """Check whether this text is a protocol. Faults are reported with their places."""
    try:
        codec = codec_of(text)
    except ProtocolFileError as error:
        return {"ok": False, "problems": problems_of(error)}
    return {"ok": True, "problems": [], "protocol": codec.name, "hash": f"{codec.hash:016x}"}


def problems_of(error: ProtocolFileError) -> list[dict[str, Any]]:
    """Return the problems of a protocol file with their places."""
    return [{"message": p.sentence, "line": p.line, "column": p.column} for p in error.problems]


def imported(header: str, name: str) -> dict[str, Any]:
    """Return a protocol file made from a C header.

    :raises UsageError: it says nothing that can be used; the sentence has its lines.
    """
    with tempfile.TemporaryDirectory(prefix="wirebond-import-") as folder:
        path = Path(folder) / f"{name}.h"
        path.write_text(header, encoding="utf-8")
        try:
            found = import_header(path, name)
        except HeaderFileError as error:
            raise UsageError(str(error).replace(f"{folder}/", "")) from None
    return {"name": name, "text": found.text, "notes": list(found.notes), "messages": found.messages}
