"""Writing files whole or not at all: a reader sees the old content or the new one, at any moment."""

from __future__ import annotations

import errno
import os
import secrets
import stat
import sys
from contextlib import suppress
from pathlib import Path


def write_whole(path: Path, content: str | bytes, *, new: bool = False, lasting: bool = True) -> None:
    """Write ``content`` beside ``path``, then give it that name in one step.

    An existing file keeps its permissions and, where this process may do so, its owner; of a symbolic link it is the
    target that is written. What is not a regular file (a pipe, ``/dev/stdout``) is written as it is.

    :param path: in a folder that exists.
    :param content: text is written as UTF-8.
    :param new: no file may be at ``path`` yet.
    :param lasting: wait until it is on the disk, so that it is whole after a power failure, too.
    :raises FileExistsError: ``new``, and the file exists; it is not changed.
    :raises OSError: with ``path`` as its ``filename``; nothing was changed, and no new file is left.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    try:
        _write(path, data, new, lasting)
    except OSError as error:
        error.filename, error.filename2 = str(path), None
        raise


def _write(path: Path, data: bytes, new: bool, lasting: bool) -> None:
    if new:
        if os.path.lexists(path):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
        before, target = None, path
    else:
        try:
            before = path.stat()
        except FileNotFoundError:
            before = None
        target = Path(os.path.realpath(path))
    if before is not None and stat.S_ISDIR(before.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if before is not None and not stat.S_ISREG(before.st_mode):
        with path.open("wb") as file:
            file.write(data)
        return
    if before is not None and not os.access(target, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    unfinished = target.parent / f".wirebond-{secrets.token_hex(6)}.tmp"
    descriptor = os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
    try:
        with open(descriptor, "wb") as file:  # noqa: PTH123 it is open already
            if before is not None and sys.platform != "win32":
                with suppress(OSError):  # another's file: its content may be replaced, its owner cannot be given
                    os.fchown(descriptor, before.st_uid, before.st_gid)
                os.fchmod(descriptor, stat.S_IMODE(before.st_mode))
            file.write(data)
            file.flush()
            if lasting:
                os.fsync(descriptor)
        if new:
            name_new(unfinished, target)
        else:
            unfinished.replace(target)
    finally:
        unfinished.unlink(missing_ok=True)


def name_new(unfinished: Path, target: Path) -> None:
    """Give a finished file its name, where nothing has that name yet.

    A link fails in one step if something exists there; on a file system without links, that is checked before.

    :raises FileExistsError: something exists there; it is left as it is.
    """
    try:
        os.link(unfinished, target)
    except FileExistsError:
        raise
    except OSError:
        if os.path.lexists(target):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST)) from None
        unfinished.rename(target)
