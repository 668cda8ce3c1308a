"""Single files below /sys and /dev, as text: what cannot be read is None, whatever the reason. No meaning."""

from __future__ import annotations

import os
from pathlib import Path


def text(path: Path | str) -> str | None:
    """Return a small file without the line's end; None if it is not there or may not be read."""
    try:
        with open(path, encoding="utf-8", errors="replace") as file:  # noqa: PTH123 called for each tty: a path object costs
            return file.read().strip()
    except OSError:
        return None


def number(path: Path | str, base: int = 10) -> int | None:
    """Return the number in a small file; None if there is none."""
    found = text(path)
    try:
        return None if found is None else int(found, base)
    except ValueError:
        return None


def linked_name(path: Path | str) -> str | None:
    """Return the last part of what a symbolic link shows: the driver's name of ``.../driver``."""
    try:
        return Path(os.readlink(path)).name  # noqa: PTH115 as above
    except OSError:
        return None


def below(root: Path, path: str) -> Path:
    """Return the place of an absolute path in the tree whose top is `root`."""
    return root / path.lstrip("/")


def names(folder: Path) -> list[str]:
    """Return the sorted names in a folder. Empty if it does not exist or cannot be read."""
    try:
        return sorted(os.listdir(folder))  # noqa: PTH208 names are wanted, not paths
    except OSError:
        return []
