"""The check after each edit: lints the changes and runs the pure tests that they can reach.

    python -m tests.runner.check [--since COMMIT] [--workers N]

A test reaches what its module imports, directly or through others. A file that is not Python is reached by the modules
that name it, and the engine's C++ by those that import the engine. The nearest tests run first; what does not fit into
a minute is counted and left to `make test`.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import time
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import grimp

from tests.runner.__main__ import FAILED, PASSED, ROOT, EndedEarlyError, pytest, show

SECONDS = 60.0  # for all of it
_TO_END = 4.0  # seconds for the tests that run when the time is over, and for the report
_SHOWN = 10  # names
_SOURCES = {"wirebond": ROOT / "python" / "src", "tests": ROOT, "bench": ROOT}
_ENGINE = re.compile(r"^(core/include|engine|python/native|ports/posix)/.*\.[ch]pp$|^CMakeLists\.txt$")
_PYTHON = re.compile(r"^(python|ros2|tests|bench)/.*\.pyi?$")
_CPP = re.compile(r"\.(cpp|hpp|h|c)$")
_PAGE = re.compile(r"^console/")


def changed_files(since: str) -> list[str]:
    """The files that differ from this commit, seen from the project's root; not those that were deleted."""
    tracked = _git("diff", "--name-only", "--diff-filter=d", since)
    return sorted({*tracked, *_git("ls-files", "--others", "--exclude-standard")})


def reaching(changed: Iterable[str]) -> list[str]:
    """The test files that reach one of these, the nearest first."""
    graph = grimp.build_graph(*_SOURCES, cache_dir=str(ROOT / "build" / "imports"))
    distance = {module: 0 for file in changed for module in _first_users(file, graph.modules)}
    edge = list(distance)
    while edge:
        users = {user: distance[module] + 1 for module in edge for user in _users(module, graph)}
        edge = [user for user in users if user not in distance]
        distance |= {user: users[user] for user in edge}
    tests = [module for module in distance if module.rpartition(".")[2].startswith("test_")]
    tests.sort(key=lambda module: (distance[module], module))
    return [str(_file(module).relative_to(ROOT)) for module in tests]


def _users(module: str, graph: grimp.ImportGraph) -> set[str]:
    """The modules that use this one: pytest gives a folder what is in its conftest."""
    folder, _, name = module.rpartition(".")
    return graph.find_modules_that_directly_import(module) | (
        graph.find_descendants(folder) if name == "conftest" else set()
    )


def _first_users(file: str, modules: Iterable[str]) -> list[str]:
    """The module that this file is, or the modules that use it without an import."""
    if file == "conftest.py":
        return list(modules)
    if file.endswith(".py"):
        return [module for module in modules if _file(module) == ROOT / file]
    name = r"_engine" if _ENGINE.match(file) else re.escape(Path(file).stem)
    return [module for module in modules if re.search(rf"\b{name}\b", _text(module))]


@cache
def _file(module: str) -> Path:
    base = _SOURCES[module.partition(".")[0]].joinpath(*module.split("."))
    package = base / "__init__.py"
    return package if package.exists() else base.with_suffix(".py")


@cache
def _text(module: str) -> str:
    return _file(module).read_text(encoding="utf-8")


def linters(changed: Iterable[str]) -> dict[str, list[str]]:
    """The commands that look at these files, by name."""
    python = [file for file in changed if _PYTHON.search(file)]
    cpp = [file for file in changed if _CPP.search(file)]
    tools = Path(sys.executable).parent
    found: dict[str, list[str]] = {}
    if python:
        found["ruff format"] = [str(tools / "ruff"), "format", "--check", "--quiet", *python]
        found["ruff"] = [str(tools / "ruff"), "check", "--quiet", *python]
        found["mypy"] = [str(tools / "mypy"), "--no-error-summary"]
        found["waiting"] = [sys.executable, "tests/architecture/waiting_rules.py"]
    if cpp:
        found["clang-format"] = ["clang-format-14", "--dry-run", "--Werror", *cpp]
    if python or cpp:
        found["dependencies"] = [sys.executable, "tests/architecture/dependency_rules.py"]
    if any(_PAGE.match(file) for file in changed):
        found["page"] = ["npm", "--prefix", "console", "run", "--silent", "check"]
        found["tests of the page"] = ["npm", "--prefix", "console", "run", "--silent", "test"]
    return found


def prepare() -> None:
    """Build what the change makes out of date: the engine, the page.

    :raises EndedEarlyError: it does not build; the compiler has printed why.
    """
    if subprocess.run(["make", "--no-print-directory", "build/setup-test.stamp"], cwd=ROOT, check=False).returncode:
        raise EndedEarlyError("failed: it does not build")


def check(since: str, workers: int) -> int:
    began = time.monotonic()
    changed = changed_files(since)
    if not changed:
        print(f"Nothing differs from {since}. `make check SINCE=HEAD~1` checks the last commit.")
        return PASSED
    show(f"changed since {since}", changed[:_SHOWN] + [f"and {len(changed) - _SHOWN} more"] * (len(changed) > _SHOWN))
    prepare()
    built = time.monotonic()
    commands = linters(changed)
    found = [name for name, command in commands.items() if subprocess.run(command, cwd=ROOT, check=False).returncode]
    linted = time.monotonic()
    files = reaching(changed)
    until = max(began + SECONDS - _TO_END, time.monotonic() + _TO_END)
    kinds = "not live and not timed and not long"
    results = pytest("-n", str(workers), "--until", str(until), "-m", kinds, *files, may_be_empty=True) if files else []
    failed = [result.name for result in results if not result.has_passed]
    left_out = sum(result.is_left_out for result in results)
    show("found something", found)
    show("failed", failed)
    print(
        f"\n{'failed' if found or failed else 'passed'} in {time.monotonic() - began:.0f} s: "
        f"set-up in {built - began:.0f} s, {len(commands)} linters in {linted - built:.0f} s, "
        f"{len(results) - left_out} pure tests in {time.monotonic() - linted:.0f} s"
        + (f"; {left_out} farther from the change found no time" if left_out else "")
        + f". `make test` runs the live tests of {len(files)} files that reach it, too." * bool(files)
    )
    return FAILED if found or failed else PASSED


def _git(*arguments: str) -> list[str]:
    told = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    if told.returncode:
        raise EndedEarlyError(f"git {' '.join(arguments)}: {told.stderr.strip()}")
    return told.stdout.splitlines()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--since", default="HEAD", help="the commit to compare with; default: %(default)s")
    parser.add_argument("--workers", type=int, default=2, help="processes for the tests")
    chosen = parser.parse_args()
    try:
        return check(chosen.since, chosen.workers)
    except EndedEarlyError as error:
        print(error)
        return FAILED


if __name__ == "__main__":
    sys.exit(main())
