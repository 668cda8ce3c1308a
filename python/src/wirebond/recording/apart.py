"""Closing a recording in a process of its own: the program that recorded it loses none of its time."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from pathlib import Path

from wirebond.system import APART, give_way

_SIGNALLED = 130  # exit code after Ctrl-C


def begin_closing(path: Path) -> subprocess.Popen[bytes]:
    """Return a process that closes it. Its exit code is 0 when it has, and SIGINT ends it, with the file as it was. It
    continues when its starter ends.

    :raises OSError: it cannot be started.
    """
    return subprocess.Popen(
        [sys.executable, "-m", "wirebond.recording.apart", str(path)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        **APART,
    )


def _main(path: Path) -> int:
    from wirebond.errors import WirebondError  # noqa: PLC0415 nice before the long imports
    from wirebond.recording.closing import close_recording  # noqa: PLC0415

    try:
        close_recording(path)
    except (WirebondError, OSError):
        return 1
    except KeyboardInterrupt:
        return _SIGNALLED
    return 0


if __name__ == "__main__":
    with contextlib.suppress(OSError):
        give_way(5)
    sys.exit(_main(Path(sys.argv[1])))
