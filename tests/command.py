"""The ``wirebond`` command, run to its end in a process of its own.

Half of the time of a short command is its start, so these processes are forked from one that has imported the command.
How a command starts, from the first module on, is what tests/end_to_end/test_cli_endings.py tests.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import tempfile
from pathlib import Path
from subprocess import CompletedProcess

from tests.waiting import PATIENCE

_FORKS = multiprocessing.get_context("forkserver")
_FORKS.set_forkserver_preload(["tests.command_loaded"])


def run(*arguments: str, stdin: bytes = b"", cwd: Path | None = None) -> CompletedProcess[str]:
    """:returns: its exit code, and what it wrote; there is no traceback in it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "stdin").write_bytes(stdin)
        process = _FORKS.Process(target=_command, args=(arguments, folder, cwd or Path.cwd()))
        process.start()
        process.join(PATIENCE)
        if process.exitcode is None:
            process.kill()
            process.join()
            raise TimeoutError(f"wirebond {' '.join(arguments)} did not end within {PATIENCE} s")
        out, err = (folder / "stdout").read_text(), (folder / "stderr").read_text()
    assert "Traceback" not in out + err
    return CompletedProcess(["wirebond", *arguments], process.exitcode, out, err)


def _command(arguments: tuple[str, ...], streams: Path, cwd: Path) -> None:
    for number, name, mode in ((0, "stdin", os.O_RDONLY), (1, "stdout", os.O_WRONLY), (2, "stderr", os.O_WRONLY)):
        os.dup2(os.open(streams / name, mode | os.O_CREAT, 0o600), number)
    os.chdir(cwd)
    sys.argv = ["wirebond", *arguments]
    sys.stdin = open(0, closefd=False)  # noqa: SIM115 multiprocessing has closed it

    from wirebond.cli.start import main  # noqa: PLC0415 it takes Ctrl-C over, and this module is imported by tests, too

    main()
