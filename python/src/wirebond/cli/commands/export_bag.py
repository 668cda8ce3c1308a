"""``wirebond export --to ros2``."""

from __future__ import annotations

from pathlib import Path

from wirebond.cli.commands.recordings import progress_bar, read
from wirebond.cli.output import plain, warn, write
from wirebond.errors import UsageError
from wirebond.protocol.problems import no_message
from wirebond.ros2.bag import write_bag
from wirebond.ros2.serving import mapping_for


def export_bag(
    path: Path, message: str | None, folder: Path, protocol: Path | None, mapping: Path | None, force: bool
) -> int:
    """Write the bag, and print its folder."""
    recording = read(path, protocol)
    for problem in recording.problems:
        warn(problem)
    names = [m.name for m in recording.codec.model.messages]
    if message is not None and message not in names:
        raise UsageError(no_message(recording.codec.name, message, names))
    out = folder / f"{path.stem}-ros2"
    with progress_bar("writing a bag") as progress:
        topics = mapping_for(recording.codec, mapping)
        lacking = write_bag(recording, out, topics, message, force=force, progress=progress)
    for sentence in lacking:
        warn(sentence)
    write(f"{plain(str(out))}\n")
    return 0
