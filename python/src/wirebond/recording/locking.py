"""Says to others that a file is being written: a lock, where the system and the file's place have one."""

from __future__ import annotations

import sys


def lock(descriptor: int) -> bool:
    """Lock until the descriptor is closed. False: another one has it. On Windows a lock would keep others from reading
    the file, so there is none."""
    if sys.platform == "win32":
        return True
    import fcntl  # noqa: PLC0415 Windows has none

    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True
