"""Templates of files that are written, by jinja2."""

from __future__ import annotations

from pathlib import Path

import jinja2


def environment(folder: Path) -> jinja2.Environment:
    """Return the templates of a folder. What a template names must be given; its own tags leave no lines."""
    return jinja2.Environment(  # noqa: S701 what is written is not markup
        loader=jinja2.FileSystemLoader(folder),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
