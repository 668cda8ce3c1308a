"""One self-contained file out of a generated text and the headers that it includes."""

from __future__ import annotations

import re
from collections.abc import Mapping

_INCLUDE = re.compile(r'^#include "([^"]+)"$')


def amalgamated(text: str, headers: Mapping[str, str]) -> str:
    """Replace the first include of each of ``headers`` in ``text`` by its content. Headers are known by the names in
    quotes, in a header also by those beside it.

    A core header gets a guard of its own, so that several amalgamated files may be included together. Other includes
    stay as they are.
    """
    seen: set[str] = set()
    return "".join(_inlined(text, headers, seen))


def _inlined(text: str, headers: Mapping[str, str], seen: set[str], folder: str = "") -> list[str]:
    lines: list[str] = []
    for line in text.splitlines(keepends=True):
        found = _INCLUDE.match(line.rstrip())
        names = [] if found is None else [found[1], folder + found[1]]
        name = next((name for name in names if name in headers), None)
        if name is None:
            lines.append(line)
        elif name not in seen:
            seen.add(name)
            inner = _inlined(_without_pragma(headers[name]), headers, seen, name.rpartition("/")[0] + "/")
            lines += _guarded(name, inner)
    return lines


def _guarded(name: str, lines: list[str]) -> list[str]:
    guard = "WIREBOND_AMALGAMATED_" + re.sub(r"[^A-Z0-9]", "_", name.removeprefix("wirebond/").upper())
    return [f"// ---- {name}\n", f"#ifndef {guard}\n", f"#define {guard}\n", *lines, f"#endif  // {guard}\n"]


def _without_pragma(text: str) -> str:
    return text.replace("#pragma once\n", "", 1)
