"""Is a pty still the one that was opened? Its number goes to the next program that asks for a pty."""

from __future__ import annotations

import contextlib
import os
import stat
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

# The major numbers of pty slaves: Linux, Documentation/admin-guide/devices.txt.
_PTY_MAJORS = range(136, 144)
_File = tuple[int, int, int]  # device, inode, time of the last change in ns (a pty's: when it was made)


@dataclass(frozen=True)
class _Seen:
    name: _File  # the path itself: the pty, or a symbolic link to it
    pty: _File


class PtyNumber:
    """Remembers the target of a path, like the engine's class of the same name. One thread at a time."""

    def __init__(self) -> None:
        self._before: _Seen | None = None

    def remember(self, path: str) -> None:
        """Remember that the path was opened."""
        self._before = _look(path)

    @contextlib.contextmanager
    def kept(self, path: str) -> Iterator[None]:
        """Keep the path open, if the remembered one is a pty, so that its number cannot go to another program between
        the check and the opening.

        :raises OSError: the path cannot be opened.
        """
        if self._before is None or sys.platform == "win32":
            yield
            return
        kept = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            yield
        finally:
            os.close(kept)

    def is_a_strangers(self, path: str) -> bool:
        """Return whether the path is now another program's pty: the remembered one has ended, although the path itself
        is unchanged.

        The same number is never the same pty, even if both were made at the same time: the file system's clock has
        steps of milliseconds.
        """
        now = _look(path)
        if self._before is None or now is None:
            return False
        return now.name in (self._before.name, now.pty)  # no new symbolic link leads to it


def sentence(path: str) -> str:
    """Write why a pty of another program is not opened."""
    return (
        f"{path} is another program's terminal now, because a pty's number is given away when it ends; open the new "
        "pty by its own name, or use a link to it that stays (wirebond sim --link NAME)"
    )


def _look(path: str) -> _Seen | None:
    """Read the pty's number; None: the path is not a pty, or the numbers of ptys are not known, as on macOS."""
    if sys.platform != "linux":
        return None
    try:
        name, device = Path(path).lstat(), Path(path).stat()
    except OSError:
        return None
    if not stat.S_ISCHR(device.st_mode) or os.major(device.st_rdev) not in _PTY_MAJORS:
        return None
    return _Seen(_file(name), _file(device))


def _file(found: os.stat_result) -> _File:
    return (found.st_dev, found.st_ino, found.st_ctime_ns)
