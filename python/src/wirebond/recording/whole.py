"""Long files that are there whole or not at all, whoever stops their writing."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from wirebond.whole_file import name_new


@contextlib.contextmanager
def whole_file(out: Path, *, new: bool = False) -> Iterator[IO[bytes]]:
    """Yield a file beside ``out``, which takes that name when the block ends without an exception.

    :param new: nothing may exist at ``out``.
    :raises FileExistsError: ``new``, and something exists there; it is left as it is.
    :raises OSError: with ``out`` as its ``filename``; nothing was changed, and no file is left.
    """
    target = out if new else Path(os.path.realpath(out))
    unfinished = target.parent / f".wirebond-{secrets.token_hex(6)}.tmp"
    try:
        if new and os.path.lexists(target):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
        if target.is_dir():
            raise IsADirectoryError(21, "a folder")
        descriptor = os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        with os.fdopen(descriptor, "wb") as file:
            if target.exists() and sys.platform != "win32":
                os.fchmod(file.fileno(), target.stat().st_mode & 0o7777)
            yield file
            file.flush()
            os.fsync(file.fileno())
        if new:
            name_new(unfinished, target)
        else:
            unfinished.replace(target)
    except OSError as error:
        if error.filename in (None, str(unfinished), unfinished):
            error.filename, error.filename2 = str(out), None
        raise
    finally:
        with contextlib.suppress(OSError):
            unfinished.unlink(missing_ok=True)
