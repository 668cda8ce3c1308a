"""``wirebond info`` and ``wirebond export``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from wirebond.cli.commands.recordings_view import facts, lines
from wirebond.cli.output import errors, plain, warn, write
from wirebond.cli.values import to_json
from wirebond.codec import Codec, load
from wirebond.errors import WirebondError
from wirebond.recording.closing import close_recording
from wirebond.recording.export import export
from wirebond.recording.recording import Recording

Progress = Callable[[int, int], object]


@contextmanager
def progress_bar(what: str) -> Iterator[Progress | None]:
    """Show a bar on stderr, if that is a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Bar(*columns, console=errors, transient=True) as bar:
        task = bar.add_task(what)
        yield lambda done, size: bar.update(task, completed=done, total=size)


def read(path: Path, protocol: Path | None) -> Recording:
    """Read a recording, with a progress bar."""
    codec: Codec | None = None if protocol is None else load(protocol)
    with progress_bar(f"reading {plain(path.name)}") as progress:
        return Recording(path, codec, progress=progress)


def show_info(path: Path, protocol: Path | None, as_json: bool, repair: bool) -> int:
    """Show facts of a recording. Repairs one that was not closed, and says so."""
    recording = read(path, protocol)
    accounts = {sender: recording.stats(sender) for sender in ("mcu", "host")}
    repaired = False
    if repair and not recording.is_closed and not recording.is_capture:
        repaired = _close(path) and bool(recording.problems)  # otherwise it is only compressed
    if as_json:
        write(to_json(facts(recording, accounts, repaired)) + "\n")
    else:
        write("\n".join(lines(recording, accounts, repaired)) + "\n")
    for problem in recording.problems:
        warn(problem)
    return 0


def _close(path: Path) -> bool:
    try:
        with progress_bar(f"closing {plain(path.name)}") as progress:
            close_recording(path, progress=progress)
    except (WirebondError, OSError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        warn(f"it was not closed, and cannot be closed here ({reason}); it is as it was")
        return False
    return True


def export_recording(path: Path, to: str, message: str | None, folder: Path, protocol: Path | None, force: bool) -> int:
    """Export the recording, and print the files."""
    recording = read(path, protocol)
    for problem in recording.problems:
        warn(problem)
    with progress_bar(f"writing {to}") as progress:
        written = export(recording, to, folder, message, force=force, progress=progress)
    write("".join(f"{one}\n" for one in written))
    if not written:
        errors.print("the recording has no such message" if message else "the recording has no message")
    return 0 if written else 1
