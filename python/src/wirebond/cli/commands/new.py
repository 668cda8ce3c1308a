"""What ``wirebond new`` does: a template becomes a user's own file."""

from __future__ import annotations

from pathlib import Path

from wirebond.cli.output import console, plain
from wirebond.generate.new import write_template


def write_first_file(path: Path, template: str) -> None:
    write_template(path, template)
    console.print(plain(f"{path}: put your messages in, then run `wirebond check {path}`"), soft_wrap=True)
