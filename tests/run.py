"""Runs the tests as `make test` does: all at once, and tests that failed once more, alone and one at a time.

    python -m tests.run -n 3 --dist worksteal -m "not long"     arguments are those of pytest

A test that fails twice fails the run. A test that passes alone is listed at the end: it depends on what runs beside it,
which is a defect, too.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CACHE = ROOT / "build" / "pytest"  # of this run alone: pytest's own also remembers failures of other runs
MOST_REPEATED = 25  # more failures than these are no accident
FAILED = 1  # exit code of pytest


def pytest(arguments: list[str]) -> int:
    command = [sys.executable, "-m", "pytest", "-o", f"cache_dir={CACHE}", *arguments]
    return subprocess.run(command, cwd=ROOT, check=False).returncode


def failed() -> list[str]:
    """Return the tests that failed in the last run, by pytest's names."""
    file = CACHE / "v" / "cache" / "lastfailed"
    return sorted(json.loads(file.read_text())) if file.exists() else []


def run(arguments: list[str]) -> int:
    shutil.rmtree(CACHE, ignore_errors=True)
    code = pytest(arguments)
    first = failed()
    if code != FAILED or not 0 < len(first) <= MOST_REPEATED:
        return code
    print(f"\n{len(first)} failed; each is repeated alone:", *first, sep="\n  ", flush=True)
    twice = [name for name in first if pytest(["-n", "0", name])]
    for title, names in (
        ("failed once and passed alone", [name for name in first if name not in twice]),
        ("failed twice", twice),
    ):
        if names:
            print(f"\n{len(names)} {title}:", *names, sep="\n  ", flush=True)
    return FAILED if twice else 0


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:]))
