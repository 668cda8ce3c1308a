"""Finds additions to a link from packages above this one: ports such as ``sim:`` and ``replay:``, and the recorder.

They are entry points of the group ``wirebond.link`` in pyproject.toml, so that this package imports none of them.
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points
from typing import Any

GROUP = "wirebond.link"


@cache
def plugin(name: str) -> Any:
    """Return the class or function registered under this name; it is imported when first asked for."""
    [found] = {(e.module, e.attr): e for e in entry_points(group=GROUP, name=name)}.values()
    return found.load()
