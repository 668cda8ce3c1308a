"""Computes the stack depth of a program's functions: a bound over all call paths, from the compiler's output for each
function.

GCC's ``-fcallgraph-info=su`` writes who calls whom and how much stack each takes. Tail calls are counted as calls.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

# Of newlib-nano and libgcc for ARM, read from their code: registers that they push, those of what they call included.
LIBRARY_BYTES = {
    "__aeabi_ldivmod": 48,
    "__aeabi_uldivmod": 48,
    "memchr": 16,
    "memcmp": 16,
    "memcpy": 4,
    "memmove": 16,
    "memset": 12,
}

_NODE = re.compile(r'node: \{ title: "([^"]+)" label: "([^"]*)"')
_EDGE = re.compile(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')
_SIZE = re.compile(r"(\d+) bytes \((\w[\w,]*)\)")


@dataclass
class _Function:
    own_bytes: int
    calls: set[str] = field(default_factory=set)


def stack_depth(graph: Path, entry: str) -> int:
    """Bytes that ``entry``, an ``extern "C"`` function, takes at most.

    AssertionError where there is no bound: recursion, calls by pointer, stack of a size that is not constant, or a
    function of a library that is not listed here.
    """
    functions = _read(graph)
    depths: dict[str, int] = {}

    def depth(name: str, above: tuple[str, ...]) -> int:
        assert name not in above, f"{name} calls itself"
        if name not in depths:
            assert name in functions, f"{name}: its stack is not known; list it where it is a library's"
            function = functions[name]
            depths[name] = function.own_bytes + max((depth(c, (*above, name)) for c in function.calls), default=0)
        return depths[name]

    found = [name for name in functions if name.rpartition(":")[2] == entry or name == entry]
    assert len(found) == 1, f"{entry} is there {len(found)} times"
    return depth(found[0], ())


def _read(graph: Path) -> dict[str, _Function]:
    functions = {name: _Function(size) for name, size in LIBRARY_BYTES.items()}
    edges = []
    for line in graph.read_text(encoding="utf-8").splitlines():
        if node := _NODE.match(line):
            name, label = node.groups()
            size = _SIZE.search(label)
            if size is None:
                continue  # of another file
            assert size.group(2) == "static", f"{name}: its stack is {size.group(2)}"
            functions[name] = _Function(int(size.group(1)))
        elif edge := _EDGE.match(line):
            edges.append(edge.groups())
    for source, target in edges:
        functions[source].calls.add(_known(target, functions))
    return functions


def _known(name: str, functions: dict[str, _Function]) -> str:
    """Constructors and destructors have two names, of which the compiler may call the one and describe the other."""
    if name in functions:
        return name
    others = (re.sub(f"{kind}1E", f"{kind}2E", name) for kind in "CD")
    return next((other for other in others if other in functions), name)
