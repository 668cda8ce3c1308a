"""Check that tests wait as tests/waiting.py says. Part of ``make lint``.

Refused is `time.sleep`, and a comparison with a reading of a clock or with a value computed from one. Tests marked
`timed` may do both.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TESTS = ROOT / "tests"
CLOCKS = {"monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns", "process_time", "thread_time", "time"}
EXCEPTIONS: dict[str, str] = {  # file or file::function, and the reason
    "waiting.py": "the one place that waits",
    "runner/stalls.py": "measures time",
    "runner/results.py": "shows progress",
    "runner/limit.py": "leaves tests out when the time is over",
    "link/far_end.py": "a program of its own that carries bytes no faster than a wire",
    "server/writer.py": "a program of its own that sends at a pace",
    "ros2/typed_program.py": "a program of its own",
}


def problems(name: str, text: str) -> list[str]:
    """Return the problems of the file of this name, below tests/."""
    if name in EXCEPTIONS:
        return []
    look = _Look(name)
    look.visit(ast.parse(text))
    return look.problems


class _Look(ast.NodeVisitor):
    def __init__(self, name: str) -> None:
        self._name = name
        self._readings: list[set[str]] = [set()]  # of the functions around: names with a reading of a clock in them
        self.problems: list[str] = []

    def visit_Module(self, node: ast.Module) -> None:
        marks = [line for line in node.body if isinstance(line, ast.Assign) and "pytestmark" in ast.unparse(line)]
        if not any("mark.timed" in ast.unparse(line) for line in marks):
            self.generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        is_timed = any("mark.timed" in ast.unparse(decorator) for decorator in node.decorator_list)
        if is_timed or f"{self._name}::{node.name}" in EXCEPTIONS:
            return
        self._readings.append(set())
        for inner in ast.walk(node):
            if isinstance(inner, ast.Assign | ast.NamedExpr | ast.AugAssign) and self._is_reading(inner.value):
                targets = inner.targets if isinstance(inner, ast.Assign) else [inner.target]
                self._readings[-1] |= _assigned(targets, inner.value)
        self.generic_visit(node)
        self._readings.pop()

    visit_AsyncFunctionDef = visit_FunctionDef  # noqa: N815  (ast calls it so)

    def visit_Call(self, node: ast.Call) -> None:
        if ast.unparse(node.func) in ("time.sleep", "sleep"):
            self._add(node, "sleeps; use `let_pass`, or better wait for an event, from tests/waiting.py")
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        if self._is_reading(node):
            self._add(node, "compares a reading of a clock; wait with tests/waiting.py, or mark the test `timed`")
        self.generic_visit(node)

    def _is_reading(self, node: ast.AST) -> bool:
        return any(
            _is_clock(inner) or (isinstance(inner, ast.Name) and any(inner.id in names for names in self._readings))
            for inner in _without_calls(node)
        )

    def _add(self, node: ast.expr, what: str) -> None:
        self.problems.append(f"tests/{self._name}:{node.lineno}: {what}")


def _without_calls(node: ast.AST) -> list[ast.AST]:
    """The node and all inside, except the arguments of calls: a clock that is passed on compares nothing."""
    if isinstance(node, ast.Call) and not _is_clock(node):
        plain = isinstance(node.func, ast.Name) and node.func.id in ("max", "min", "round", "int", "float", "abs")
        return [node, *(found for inner in node.args if plain for found in _without_calls(inner))]
    return [node, *(found for inner in ast.iter_child_nodes(node) for found in _without_calls(inner))]


def _is_clock(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and ast.unparse(node.func.value) == "time"
        and node.func.attr in CLOCKS
    )


def _assigned(targets: list[ast.expr], value: ast.expr) -> set[str]:
    """The names that the reading gets, pair by pair in `a, b = 0, time.monotonic()`."""
    found: set[str] = set()
    for target in targets:
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple) and len(target.elts) == len(value.elts):
            pairs = zip(target.elts, value.elts, strict=True)
            found |= {ast.unparse(to) for to, what in pairs if any(_is_clock(inner) for inner in _without_calls(what))}
        else:
            found.add(ast.unparse(target))
    return found


def all_problems() -> list[str]:
    files = sorted(TESTS.rglob("*.py"))
    return [problem for file in files for problem in problems(str(file.relative_to(TESTS)), file.read_text())]


if __name__ == "__main__":
    found = all_problems()
    print("\n".join(found), file=sys.stderr)
    sys.exit(1 if found else 0)
