"""The address of a server: ``wirebond://`` and a name, the path of a socket, or a host and a port. Opens nothing."""

from __future__ import annotations

import os
import re
import stat
import sys
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

from wirebond.errors import UsageError

SCHEME = "wirebond://"
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,60}")
_LONGEST_PATH = 107 if sys.platform == "linux" else 103  # bytes of a Unix socket's path: unix(7), of macOS unix(4)
_WANTED = (
    "give wirebond://NAME (a server on this computer, by its name), wirebond:///path/to/socket, or "
    "wirebond://host:port?token=TOKEN"
)


@dataclass(frozen=True)
class ServerAddress:
    """``text``: as its user wrote it, without the token. Either ``path`` of a Unix socket, or ``host`` and ``port``."""

    text: str
    path: str = ""
    host: str = ""
    port: int = 0
    token: str = ""


def server_address(text: str) -> ServerAddress:
    """Read the address of a server. Its token is in it, or in the environment variable ``WIREBOND_TOKEN``.

    :raises UsageError: it is none.
    """
    try:
        parts = urlsplit(text)
        host, port, query = parts.hostname or "", parts.port, parse_qs(parts.query, strict_parsing=bool(parts.query))
    except ValueError:
        raise UsageError(f"{text!r} has no valid server name; {_WANTED}") from None
    if set(query) - {"token"} or parts.fragment or parts.username or parts.password:
        raise UsageError(f"{text!r} has more than a server's name; {_WANTED}")
    token = query.get("token", [os.environ.get("WIREBOND_TOKEN", "")])[0]
    plain = text.partition("?")[0]
    if not parts.netloc and len(parts.path) > 1:
        return ServerAddress(plain, path=_checked(parts.path), token=token)
    if parts.path not in ("", "/"):
        raise UsageError(f"{text!r} has a path after the server's name; {_WANTED}")
    if port:
        return ServerAddress(plain, host=host, port=port, token=token)
    if not _NAME.fullmatch(parts.netloc):
        raise UsageError(f"{text!r} has no valid server name; {_WANTED}")
    return ServerAddress(plain, path=str(socket_of(parts.netloc)), token=token)


def socket_of(name: str) -> Path:
    """Return the Unix socket of the server with this name.

    :raises UsageError: no server can have this name.
    """
    if not _NAME.fullmatch(name):
        raise UsageError(
            f"{name!r:.80} cannot be a server's name; take letters, digits, '_', '-' and '.', at most 61 of them"
        )
    return Path(_checked(str(socket_folder() / f"{name}.sock")))


def socket_folder() -> Path:
    """Return the folder for the sockets of this user's servers: in ``XDG_RUNTIME_DIR``, else in ``/tmp``. On Windows,
    where servers keep a token and an emergency stop there, in ``LOCALAPPDATA``."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime:
        return Path(runtime) / "wirebond"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home()) / "wirebond"
    return Path("/tmp") / f"wirebond-{os.getuid()}"  # noqa: S108 made with mode 0700, and its owner is checked


def make_socket_folder() -> Path:
    """Make it where it is not there, for its owner alone.

    :raises UsageError: it cannot be made, or others can write to it.
    """
    folder = socket_folder()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"cannot make the folder {folder} for the server's socket: {error.strerror or error}; set "
            "XDG_RUNTIME_DIR to a folder of yours"
        ) from None
    if sys.platform == "win32":
        return folder  # in a folder of this user, from which the system keeps others out
    found = folder.lstat()
    if found.st_uid != os.getuid() or not stat.S_ISDIR(found.st_mode) or found.st_mode & 0o022:
        raise UsageError(
            f"{folder} can be written by others, so a socket in it cannot be trusted; remove it, or set XDG_RUNTIME_DIR"
        )
    return folder


def _checked(path: str) -> str:
    if "\0" in path:
        raise UsageError(f"{path!r:.200} has a zero byte, which no path of a socket can have; give its path without it")
    if len(os.fsencode(path)) > _LONGEST_PATH:
        raise UsageError(
            f"{path!r:.200} is too long for a socket, whose path has at most {_LONGEST_PATH} bytes; name a shorter one"
        )
    return path
