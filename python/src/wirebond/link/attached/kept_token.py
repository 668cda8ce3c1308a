"""The token of this user's servers on this computer, kept in a file that only this user can read.

A server that starts again has the same token, so that pages and programs that are open attach again by themselves. The
file is beside the sockets; the system removes it with them when the user logs out or the computer starts again.
"""

from __future__ import annotations

import os
import re
import secrets
import stat
import sys
from contextlib import suppress
from pathlib import Path

from wirebond.errors import UsageError
from wirebond.link.attached.address import make_socket_folder
from wirebond.system import NOT_A_LINK, WITHOUT_WAITING

_NAME = "token"
_TOKEN = re.compile(r"[A-Za-z0-9_-]{16,64}")


def kept_token() -> str:
    """Read the token, or make and keep one. Where none can be kept, each call returns another one."""
    made = secrets.token_urlsafe(16)
    try:
        path = make_socket_folder() / _NAME
        _write_new(path, made)
        return _read(path) or made
    except (UsageError, OSError):
        return made


def _write_new(path: Path, token: str) -> None:
    """Make the file whole, and leave one that exists alone."""
    if _read(path) is not None:
        return
    other = path.with_name(f"{_NAME}.{os.getpid()}")
    with suppress(FileNotFoundError):
        other.unlink()
    descriptor = os.open(other, os.O_WRONLY | os.O_CREAT | os.O_EXCL | NOT_A_LINK, 0o600)
    try:
        with os.fdopen(descriptor, "w", encoding="ascii") as file:
            file.write(token)
        other.replace(path)
    finally:
        other.unlink(missing_ok=True)


def _read(path: Path) -> str | None:
    """Read the token; None: there is no file that only this user can read."""
    try:
        descriptor = os.open(path, os.O_RDONLY | NOT_A_LINK | WITHOUT_WAITING)
    except OSError:
        return None
    with os.fdopen(descriptor, "rb") as file:
        found = os.fstat(file.fileno())
        if not stat.S_ISREG(found.st_mode):
            return None
        if sys.platform != "win32" and (found.st_uid != os.geteuid() or found.st_mode & 0o077):
            return None
        text = file.read(100).decode("ascii", "replace")
    return text if _TOKEN.fullmatch(text) else None
