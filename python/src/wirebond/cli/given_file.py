"""A protocol file as a command names it: a path, or ``-`` for stdin."""

from __future__ import annotations

import sys
from pathlib import Path

from wirebond.codec import Codec, load
from wirebond.errors import UsageError
from wirebond.protocol.loader import loads
from wirebond.protocol.text.yaml_tree import MAX_FILE_BYTES, decoded

STDIN = Path("<stdin>")  # as problems and results name it


def is_stdin(path: Path) -> bool:
    return str(path) == "-"


def load_given(path: Path) -> tuple[Codec, Path]:
    """Return the protocol, and the name under which a person knows its file.

    :raises ProtocolFileError: with every problem of the file.
    :raises UsageError: stdin is a terminal.
    """
    if not is_stdin(path):
        return load(path), path
    if sys.stdin.isatty():
        raise UsageError("- reads the protocol file from stdin, and stdin is a terminal; pipe a file into it")
    return Codec(loads(decoded(sys.stdin.buffer.read(MAX_FILE_BYTES + 1), str(STDIN)), str(STDIN))), STDIN
