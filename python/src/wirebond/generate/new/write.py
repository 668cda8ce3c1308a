"""Writing a first file, and never over an existing one."""

from __future__ import annotations

import re
from pathlib import Path

from wirebond.errors import UsageError
from wirebond.protocol import names
from wirebond.whole_file import write_whole


def write_new(path: Path, text: str) -> None:
    """Write ``text`` to a file that must not exist yet; its folder must.

    :raises UsageError: the file exists already.
    :raises OSError: the file cannot be written; none is left.
    """
    try:
        write_whole(path, text, new=True)
    except FileExistsError:
        raise UsageError(f"{path} exists already, and is left as it is; name another file") from None


def protocol_name(path: Path) -> str:
    """Return a protocol's name after its file: ``My-Robot.yaml`` gives ``my_robot``; ``my_protocol`` where nothing
    fits."""
    words = re.sub("[^a-z0-9]+", "_", path.name.split(".")[0].lower()).strip("_")
    words = re.sub("^[0-9_]+", "", words)
    return words if words and not names.protocol_fault(words) else "my_protocol"
