"""Check the dependency rules: which folder may use which. Part of ``make lint``.

The rules are the two tables of docs/DESIGN.md under "Dependencies". Everything that they do not allow is refused. In
the package, files may not import each other in large circles, nor use a private name of another package. A long source
file says at its top why it is one file.
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
# What the vendors' own headers are called, which a port is written for. They are not part of this project.
VENDOR = re.compile(r"^(stm32[a-z0-9]+xx(_hal(_[a-z0-9]+)?)?|gd32f[a-z0-9]+|FreeRTOS|task|usbd_cdc|tusb|Arduino)\.h$")
MAY_USE_VENDOR = ("ports/", "firmware/boards/")


@dataclass(frozen=True)
class Rules:
    """The dependencies that docs/DESIGN.md allows."""

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
    folders = ["core/include", "sim/include", "firmware", "engine/include", "python/native"]
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

MAX_CIRCLE = 3  # files that import each other


def python_problems(rules: Rules) -> list[str]:
    """Return a sentence for each import that the rules do not allow, and for each package without a row."""
    problems = order_problems(rules)
    for path in sorted(PACKAGE.rglob("*.py")):
        module = module_of(path)
        if module == "":  # the package's own face
            continue
        package = python_package(rules, module)
        where = path.relative_to(ROOT).as_posix()
        if package is None:
            problems.append(f"{where}: docs/DESIGN.md has no row for this package; say there what it may use")
            continue
        for line, imported in _imports(path):
            problem = f"{where}:{line}: {package} must not import {imported}"
            if imported.split("/")[0] in ("tests", "bench", "docs"):
                problems.append(problem)
            elif imported.startswith("wirebond/"):
                target = python_package(rules, imported.removeprefix("wirebond/"))
                if target not in (package, *rules.python[package]):
                    may = ", ".join(sorted(rules.python[package])) or "only itself"
                    problems.append(f"{problem}; it may use {may}")
    return problems


def order_problems(rules: Rules) -> list[str]:
    """Return a sentence for each package that may use one of a row below its own."""
    rows = list(rules.python)
    return [
        f"docs/DESIGN.md: {package} may use {used}, whose row is not above its own; move a row, or use it no more"
        for number, package in enumerate(rows)
        for used in sorted(rules.python[package])
        if used != "_engine" and used not in rows[:number]
    ]


def circle_problems() -> list[str]:
    """Return a sentence for each circle of too many files that import each other."""
    files = {module_of(path): path for path in sorted(PACKAGE.rglob("*.py"))}
    uses = {
        module: {name for _, imported in _imports(path) if (name := imported.removeprefix("wirebond/")) in files}
        for module, path in files.items()
        if module
    }
    reaches = {module: _reached(uses, module) for module in uses}
    circles = {
        frozenset(other for other in reached if module in reaches.get(other, ())) for module, reached in reaches.items()
    }
    return [
        f"{len(circle)} files import each other in a circle: {', '.join(sorted(circle))}; at most {MAX_CIRCLE} may"
        for circle in sorted(circles, key=sorted)
        if len(circle) > MAX_CIRCLE
    ]


def _reached(uses: dict[str, set[str]], module: str) -> set[str]:
    found: set[str] = set()
    waiting = [module]
    while waiting:
        new = uses.get(waiting.pop(), set()) - found
        found |= new
        waiting += new
    return found


def private_problems(rules: Rules) -> list[str]:
    """Return a sentence for each private name that a package uses and does not define."""
    used: dict[str, list[tuple[str, int, str]]] = {}
    defined: dict[str, set[str]] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        package = python_package(rules, module_of(path)) or ""
        where = path.relative_to(ROOT).as_posix()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                defined.setdefault(package, set()).add(node.name)
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                defined.setdefault(package, set()).add(node.target.id)
            elif isinstance(node, ast.Attribute) and _is_private(node.attr):
                if isinstance(node.value, ast.Name) and node.value.id in ("self", "cls"):
                    defined.setdefault(package, set()).add(node.attr)
                else:
                    used.setdefault(package, []).append((where, node.lineno, node.attr))
    return [
        f"{where}:{line}: {name} is private to another package; make it public there, or do without it"
        for package, names in used.items()
        for where, line, name in names
        if name not in defined.get(package, ()) and any(name in others for others in defined.values())
    ]


def _is_private(name: str) -> bool:
    return name.startswith("_") and not name.endswith("__")


LONG = 450  # lines of a source file
_SOURCES = {"core/include": "*.h*", "ports": "*.[hc]*", "sim": "*.[hc]pp", "firmware": "*.[hc]pp", "python": "*.py",
            "engine": "*.[hc]pp", "python/native": "*.[hc]pp", "console/src": "*.[ts]*"}  # fmt: skip


def length_problems() -> list[str]:
    """Return a sentence for each long source file that does not begin with the reason why it is one file."""
    problems = []
    for folder, endings in _SOURCES.items():
        for path in sorted((ROOT / folder).rglob(endings)):
            if not path.is_file():
                continue
            lines = path.read_text(encoding="utf-8").splitlines()
            if len(lines) > LONG and not any("One file" in line for line in lines[:12]):
                problems.append(
                    f"{path.relative_to(ROOT)} has {len(lines)} lines; divide it, or begin with a sentence "
                    "`One file: …` that says what holds it together"
                )
    return problems


def module_of(path: Path) -> str:
    """Return the module of a file below the package, as a path."""
    name = path.relative_to(PACKAGE).with_suffix("").as_posix()
    return "" if name == "__init__" else name.removesuffix("/__init__")


def python_package(rules: Rules, module: str) -> str | None:
    """Return the row of the table for this module."""
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
    problems = cpp_problems(rules) + python_problems(rules) + circle_problems() + private_problems(rules)
    problems += length_problems()
    for problem in problems:
        print(problem)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
