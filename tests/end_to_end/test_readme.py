"""The README's commands for a newcomer's own robot work as printed."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.waiting import PATIENCE

pytestmark = pytest.mark.live
README = Path(__file__).resolve().parents[2] / "README.md"
SECTION = "## A robot of your own"
AT_ONCE = ["--web", "127.0.0.1:0", "--no-browser", "--seconds", "1"]  # in place of `--web`, which goes on


def commands() -> list[list[str]]:
    """The words of each command of the section, comments left out."""
    text = README.read_text(encoding="utf-8").split(SECTION)[1].split("\n## ")[0]
    lines = [shlex.split(line, comments=True) for line in re.findall(r"^    (wirebond .*)$", text, re.MULTILINE)]
    return [[*words[1:-1], *AT_ONCE] if words[-1] == "--web" else words[1:] for words in lines]


def test_the_commands_for_a_robot_of_ones_own_work_one_after_the_other(tmp_path: Path) -> None:
    said = {}
    for words in commands():
        done = subprocess.run(
            [sys.executable, "-m", "wirebond", *words],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=2 * PATIENCE,
            check=False,
        )
        assert done.returncode == 0, (words, done.stderr)
        said[words[0]] = done.stdout + done.stderr
    assert list(said) == ["new", "check", "serve", "gen"]
    assert "no problem found" in said["check"]
    assert "Console: http://127.0.0.1:" in said["serve"]
    assert (tmp_path / "generated" / "robot_link.hpp").is_file()
