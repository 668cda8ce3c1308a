"""A disk that is full, really: a small file system in memory."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.shared import PROTOCOLS, ROOT
from tests.waiting import PATIENCE

pytestmark = pytest.mark.live

SCRIPT = Path(__file__).with_name("on_full_disk.py")
MOUNT = 'mount -t tmpfs -o size=256k none "$0" && exec "$@"'


def namespace() -> list[str] | None:
    """Return a command that runs another one with the right to mount."""
    for options in (["--mount", "--map-root-user"], ["--mount"]):
        command = ["unshare", *options]
        try:
            mounts = subprocess.run(
                [*command, "mount", "-t", "tmpfs", "none", "/mnt"], capture_output=True, check=False
            )
        except FileNotFoundError:
            return None
        if mounts.returncode == 0:
            return command
    return None


def test_written_bytes_are_kept_the_error_is_reported_and_the_link_goes_on(tmp_path: Path) -> None:
    command = namespace()
    if command is None:
        pytest.skip("no file system can be mounted here: it takes root, or user namespaces and the program unshare")
    disk = tmp_path / "disk"
    disk.mkdir()
    found = subprocess.run(
        [
            *command,
            "sh",
            "-c",
            MOUNT,
            str(disk),
            sys.executable,
            str(SCRIPT),
            str(disk),
            str(PROTOCOLS / "diffdrive.yaml"),
        ],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        timeout=PATIENCE * 4,
        check=False,
    )
    assert found.returncode == 0, found.stdout + found.stderr
    assert found.stdout.split() == ["a_recorder_in_a_program", "a_recorder_that_closes", "the_command", "a_server"]
