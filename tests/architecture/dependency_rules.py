"""The dependency rules, checked: which folder may use which. Part of ``make lint``.

The rules themselves are the two tables of docs/DESIGN.md under "Who may use whom". What they do not allow is refused.
"""

from __future__ import annotations

import ast
import re
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "python" / "src" / "wirebond"

# Standard headers that a freestanding-style core may use: no heap, threads, streams, files or clocks.
# <new> is for objects in memory that C set aside. The last two are the compilers' own, for instructions of hosts.
FREESTANDING = {
    "algorithm", "array", "atomic", "cmath", "cstddef", "cstdint", "cstring", "limits", "new", "string_view",
    "type_traits", "utility", "stdbool.h", "stddef.h", "stdint.h", "immintrin.h", "arm_neon.h",
}  # fmt: skip
GENERATED = re.compile(r"^[a-z0-9_]+\.hpp$")
# What the vendors' own headers are called, which a port is written for. They are no part of this project.
VENDOR = re.compile(r"^(stm32[a-z0-9]+xx(_hal(_[a-z0-9]+)?)?|gd32f[a-z0-9]+|FreeRTOS|task|usbd_cdc|tusb|Arduino)\.h$")
MAY_USE_VENDOR = ("ports/", "firmware/boards/")


@dataclass(frozen=True)
class Rules:
    """What docs/DESIGN.md allows."""

    cpp: dict[str, tuple[set[str], bool]]  # folder: folders that it may use, and whether any standard header
    python: dict[str, set[str]]  # package: packages that it may use


def read_rules(text: str) -> Rules:
    """The two tables of the design page.

    :raises ValueError: one of them is not there.
    """
    cpp = {
        _names(row[0])[0]: ({*_names(row[1]), *({"generated"} if "generated code" in row[1] else ())}, row[2] == "any")
        for row in _table(text, "| C++ folder |")
    }
    python = {package: {*_names(row[2])} for row in _table(text, "| Python package |") for package in _names(row[0])}
    return Rules(cpp, python)


def _table(text: str, heading: str) -> list[list[str]]:
    lines = iter(text.splitlines())
    if not any(line.startswith(heading) for line in lines):
        raise ValueError(f"docs/DESIGN.md has no table that begins with {heading!r}; the dependency rules stand there")
    next(lines)
    rows = []
    for line in lines:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return rows


def _names(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


# ---- C++


def cpp_problems(rules: Rules) -> list[str]:
    """A sentence for each include that the rules do not allow."""
    problems = []
    tops = {folder for folder in rules.cpp if not any(folder.startswith(f"{other}/") for other in rules.cpp)}
    for path in sorted(p for top in tops for ending in ("*.[ch]pp", "*.[ch]") for p in (ROOT / top).rglob(ending)):
        relative = path.relative_to(ROOT).as_posix()
        folder = cpp_folder(rules, relative)
        allowed, any_standard = rules.cpp[folder]
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            found = re.match(r'\s*#\s*include\s*([<"])([^>"]+)[>"]', line)
            if found is None:
                continue
            bracket, header = found.groups()
            where = f"{relative}:{number}: {folder} must not include {header}"
            if bracket == "<":
                if not any_standard and header not in FREESTANDING:
                    problems.append(f"{where}; its standard headers are {', '.join(sorted(FREESTANDING))}")
            elif relative.startswith(MAY_USE_VENDOR) and VENDOR.match(header):
                continue
            elif not _cpp_allowed(rules, path, header, {folder, *allowed}):
                problems.append(f"{where}; it may use {', '.join(sorted(allowed)) or 'only itself'}")
    return problems


def cpp_folder(rules: Rules, relative: str) -> str:
    """The most particular folder of the table that this file is in."""
    return max((folder for folder in rules.cpp if relative.startswith(f"{folder}/")), key=len)


def _cpp_allowed(rules: Rules, path: Path, header: str, allowed: set[str]) -> bool:
    folders = ["core/include", "sim/include", "firmware", "python/native"]
    bases = [*(ROOT / "ports").glob("*/include"), *(ROOT / folder for folder in folders)]
    beside = [path.parent / header, path.parent.parent / header]
    for candidate in [*beside, *(base / header for base in bases)]:
        if candidate.is_file():
            target = candidate.resolve().relative_to(ROOT).as_posix()
            return any(
                target.startswith(f"{folder}/") and _is_of(rules, target, folder) for folder in allowed - {"generated"}
            )
    return "generated" in allowed and GENERATED.match(header) is not None


def _is_of(rules: Rules, target: str, folder: str) -> bool:
    """Does this row speak of the file, and no row for a folder within it?"""
    return not any(
        other.startswith(f"{folder}/") and target.startswith(f"{other}/") for other in rules.cpp if other != folder
    )


# ---- Python


def python_problems(rules: Rules) -> list[str]:
    """A sentence for each import that the rules do not allow, and for each package that has none."""
    problems = []
    for path in sorted(PACKAGE.rglob("*.py")):
        module = path.relative_to(PACKAGE).with_suffix("").as_posix().removesuffix("/__init__")
        if module == "__init__":  # what the package offers
            continue
        package = python_package(rules, module)
        where = path.relative_to(ROOT).as_posix()
        if package is None:
            problems.append(f"{where}: docs/DESIGN.md has no row for this package; say there what it may use")
            continue
        allowed = {package, *rules.python[package]}
        if package.startswith("*"):
            allowed |= rules.python[module.split("/")[0]]
        for line, imported in _imports(path):
            problem = f"{where}:{line}: {package} must not import {imported}"
            if imported.split("/")[0] in ("tests", "bench", "docs"):
                problems.append(problem)
            elif imported.startswith("wirebond/") and package != "cli":
                target = imported.removeprefix("wirebond/")
                same_room = package.startswith("*") and target.split("/")[0] == module.split("/")[0]
                if not same_room and not ({target, python_package(rules, target)} & allowed):
                    problems.append(
                        f"{problem}; it may use {', '.join(sorted(rules.python[package])) or 'only itself'}"
                    )
    return problems


def python_package(rules: Rules, module: str) -> str | None:
    """The most particular row of the table for this module: ``*/command`` before ``check``."""
    name = module.rsplit("/", maxsplit=1)[-1]
    if "/" in module and f"*/{name}" in rules.python:
        return f"*/{name}"
    packages = [package for package in rules.python if f"{module}/".startswith(f"{package}/")]
    return max(packages, key=len, default="_engine" if module == "_engine" else None)


def _imports(path: Path) -> list[tuple[int, str]]:
    """Line and module, as a path, of each import; where a name is a module, that module."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name.replace(".", "/")) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            base = node.module.replace(".", "/")
            found += [(node.lineno, _module(base, alias.name)) for alias in node.names]
    return found


def _module(base: str, name: str) -> str:
    inner = PACKAGE.parent / base / name
    is_module = inner.is_dir() or inner.with_suffix(".py").is_file() or name == "_engine"
    return f"{base}/{name}" if is_module else base


def main() -> int:
    rules = read_rules((ROOT / "docs" / "DESIGN.md").read_text(encoding="utf-8"))
    problems = cpp_problems(rules) + python_problems(rules)
    for problem in problems:
        print(problem)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
