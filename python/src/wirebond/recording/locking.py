"""Says to others that a file is being written: a lock, where the system and the file's place have one."""

from __future__ import annotations

try:
    import fcntl
except ImportError:  # as on Windows
    fcntl = None  # type: ignore[assignment]


def lock(descriptor: int) -> bool:
    """Until the descriptor is closed. False: another one has it."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True
