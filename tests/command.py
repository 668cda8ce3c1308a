"""The ``wirebond`` command, run to its end in a process of its own.

Half of the time of a short command is its start, so these processes are forked from one that has imported the command.
How a command starts, from the first module on, is what tests/end_to_end/test_cli_endings.py tests.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import sys
import tempfile
from pathlib import Path
from subprocess import CompletedProcess

from tests.waiting import PATIENCE

ROOT = Path(__file__).resolve().parents[1]

_FORKS = multiprocessing.get_context("forkserver")
_FORKS.set_forkserver_preload(["tests.command_loaded"])


def run(
    *arguments: str, stdin: bytes = b"", cwd: Path | None = None, columns: int | None = None, merged: bool = False
) -> CompletedProcess[str]:
    """:param columns: how wide its terminal is said to be.
    :param merged: both of its streams are stdout.
    :returns: its exit code, and what it wrote; there is no traceback in it.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "stdin").write_bytes(stdin)
        process = _FORKS.Process(target=_command, args=(arguments, folder, cwd or Path.cwd(), columns, merged))
        with contextlib.chdir(ROOT):  # the first one starts the process that forks, which must find its modules
            process.start()
        process.join(PATIENCE)
        if process.exitcode is None:
            process.kill()
            process.join()
            raise TimeoutError(f"wirebond {' '.join(arguments)} did not end within {PATIENCE} s")
        out, err = ((folder / name).read_text() for name in ("stdout", "stderr"))
    assert "Traceback" not in out + err
    return CompletedProcess(["wirebond", *arguments], process.exitcode, out, err)


def _command(arguments: tuple[str, ...], streams: Path, cwd: Path, columns: int | None, merged: bool) -> None:
    for number, name, mode in ((0, "stdin", os.O_RDONLY), (1, "stdout", os.O_WRONLY), (2, "stderr", os.O_WRONLY)):
        os.dup2(os.open(streams / name, mode | os.O_CREAT, 0o600), number)
    if merged:
        os.dup2(1, 2)
    os.chdir(cwd)
    sys.argv = ["wirebond", *arguments]
    sys.stdin = open(0, closefd=False)  # noqa: SIM115 multiprocessing has closed it

    from wirebond.cli.output import console, errors  # noqa: PLC0415 this module is imported by tests, too
    from wirebond.cli.start import main  # noqa: PLC0415 it takes Ctrl-C over

    if columns is not None:
        os.environ["COLUMNS"] = str(columns)
        console.width = errors.width = columns  # they have looked already
    main()
