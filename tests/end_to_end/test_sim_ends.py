"""How a simulation ends, and that two of them do not take each other's name."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

COMMAND = [sys.executable, "-m", "wirebond.cli.main", "sim", "protocols/native.yaml"]
ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_ends_it_and_its_link_is_gone(tmp_path: Path, number: signal.Signals) -> None:
    link = tmp_path / "mcu"
    process = subprocess.Popen([*COMMAND, "--link", str(link)], stdout=subprocess.PIPE, cwd=ROOT)
    assert process.stdout is not None
    try:
        assert process.stdout.readline().strip() == str(link).encode()
        other = subprocess.run(
            [*COMMAND, "--link", str(link)], capture_output=True, text=True, cwd=ROOT, timeout=60, check=False
        )
        assert other.returncode == 2
        assert "which another program serves; end that one, name another link" in other.stderr
        assert link.is_symlink()
        process.send_signal(number)
        assert process.wait(timeout=60) == 0
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
    assert not link.is_symlink()


def test_a_link_that_a_killed_one_left_is_taken_over(tmp_path: Path) -> None:
    link = tmp_path / "mcu"
    link.symlink_to(tmp_path / "gone")
    done = subprocess.run(
        [*COMMAND, "--link", str(link), "--seconds", "0.1"], capture_output=True, cwd=ROOT, timeout=60, check=False
    )
    assert done.returncode == 0
    assert not link.is_symlink()
