"""The start of the ``wirebond`` command: conditions that must hold before anything large is imported."""

from __future__ import annotations

import gc
import io
import os
import sys
from typing import TextIO

from wirebond.cli.interrupts import end_at_once, ignore

end_at_once()  # here, and not in main: only the command imports this module, and Ctrl-C may come at any moment


def main() -> None:
    """Run the installed command."""
    _open_standard_streams()
    _start_nothing_unused()
    gc.disable()  # imported modules stay, and searching them for garbage is a tenth of the start
    from wirebond.cli.main import main as run  # noqa: PLC0415 it takes a while, and Ctrl-C may come meanwhile

    gc.freeze()
    gc.enable()
    code = run()
    ignore()
    sys.exit(code)


def _start_nothing_unused() -> None:
    """Keep numpy and pydantic from starting work that no command uses: numpy starts a thread of linear algebra for each
    core, and pydantic searches all installed packages for plugins. Together they take a fifth of the processor time of
    a short command.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "1")


def _open_standard_streams() -> None:
    """Replace each standard stream that the caller closed by one that fails. Otherwise a port that is opened would take
    its place and receive error sentences. Text without a reader is lost on stderr; on stdout it is an error.
    """
    for number, mode in ((0, os.O_WRONLY), (1, os.O_RDONLY), (2, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, mode)
    sys.stdin = sys.stdin or open(0, closefd=False)  # noqa: SIM115 they live as long as the program
    sys.stdout = sys.stdout or open(1, "w", closefd=False)  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, "w", closefd=False)  # noqa: SIM115
    sys.stdout, sys.stderr = _whole(sys.stdout), _whole(sys.stderr)


def _whole(stream: TextIO) -> TextIO:
    """Return a stream that writes whole. With PYTHONUNBUFFERED, as in many containers, Python's own stream drops the
    rest of a write that a signal interrupted. Urgent output is flushed anyway.
    """
    if not isinstance(getattr(stream, "buffer", None), io.RawIOBase):
        return stream
    return open(stream.fileno(), "w", buffering=1, encoding=stream.encoding, errors=stream.errors, closefd=False)
