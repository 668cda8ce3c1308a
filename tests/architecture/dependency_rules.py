"""The dependency rules of docs/DESIGN.md, checked: which folder may use which. Part of ``make lint``."""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

# Standard headers that a freestanding-style core may use: no heap, threads, streams, files or clocks.
# <new> is for objects in memory that C set aside. The last two are the compilers' own, for instructions of hosts.
CORE_STANDARD = {
    "algorithm", "array", "atomic", "cmath", "cstddef", "cstdint", "cstring", "limits", "new", "string_view",
    "type_traits", "utility", "stdbool.h", "stddef.h", "stdint.h", "immintrin.h", "arm_neon.h",
}  # fmt: skip

# C++: folder -> (folders whose headers it may include by quotes, standard headers it may use; None: any)
CPP_RULES: dict[str, tuple[set[str], set[str] | None]] = {
    "core/include": ({"core/include"}, CORE_STANDARD),
    "ports": ({"core/include", "ports"}, None),
    "python/native": ({"core/include", "ports/posix", "python/native"}, None),
    "firmware": ({"core/include", "ports", "firmware", "generated"}, None),
}
GENERATED = re.compile(r"^[a-z0-9_]+\.hpp$")
# What the vendors' own headers are called, which a port is written for. They are no part of this project.
VENDOR = re.compile(r"^(stm32[a-z0-9]+xx_hal(_[a-z0-9]+)?|gd32f[a-z0-9]+|FreeRTOS|task)\.h$")
MAY_USE_VENDOR = ("ports/", "firmware/boards/")

# Python: module -> packages of this project that it must not import. A longer name goes before a shorter one.
PYTHON_RULES: dict[str, set[str]] = {
    "wirebond.protocol": {
        "wirebond._engine", "wirebond.codec", "wirebond.link", "wirebond.cli", "wirebond.sim", "wirebond.codegen",
        "wirebond.lint",
    },
    "wirebond.codegen": {"wirebond._engine", "wirebond.codec", "wirebond.link", "wirebond.cli", "wirebond.sim"},
    "wirebond.codec": {"wirebond.link", "wirebond.lint", "wirebond.cli", "wirebond.sim", "wirebond.codegen"},
    "wirebond.lint": {"wirebond.link", "wirebond.cli", "wirebond.sim", "wirebond.codegen"},
    "wirebond.checksum": {
        "wirebond._engine", "wirebond.codec", "wirebond.link", "wirebond.cli", "wirebond.sim", "wirebond.codegen",
        "wirebond.lint", "wirebond.explain",
    },
    "wirebond.explain": {
        "wirebond._engine", "wirebond.codec", "wirebond.link", "wirebond.cli", "wirebond.sim", "wirebond.codegen",
        "wirebond.lint", "wirebond.datasheet",
    },
    "wirebond.datasheet": {"wirebond.link", "wirebond.cli", "wirebond.sim", "wirebond.codegen"},
    "wirebond.starter": {
        "wirebond._engine", "wirebond.codec", "wirebond.link", "wirebond.cli", "wirebond.sim", "wirebond.codegen",
    },
    "wirebond.c_header": {
        "wirebond._engine", "wirebond.codec", "wirebond.link", "wirebond.cli", "wirebond.sim", "wirebond.codegen",
    },
    "wirebond.typed": {"wirebond.link", "wirebond.lint", "wirebond.cli", "wirebond.sim", "wirebond.codegen"},
    "wirebond.link": {"wirebond.cli", "wirebond.sim", "wirebond.codegen"},
    "wirebond.sim": {"wirebond.cli"},
}  # fmt: skip
NOBODY_IMPORTS = {"tests", "bench", "docs"}


def cpp_problems() -> list[str]:
    problems = []
    for folder, (allowed, standard) in CPP_RULES.items():
        for path in sorted(p for ending in ("*.[ch]pp", "*.h") for p in (ROOT / folder).rglob(ending)):
            for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
                found = re.match(r'\s*#\s*include\s*([<"])([^>"]+)[>"]', line)
                if found is None:
                    continue
                bracket, header = found.groups()
                relative = path.relative_to(ROOT).as_posix()
                where = f"{relative}:{number}: {folder} must not include {header}"
                if bracket == "<" and standard is not None and header not in standard:
                    problems.append(f"{where}; its standard headers are {', '.join(sorted(standard))}")
                elif bracket == '"' and relative.startswith(MAY_USE_VENDOR) and VENDOR.match(header):
                    continue
                elif bracket == '"' and not _cpp_allowed(path, header, allowed):
                    problems.append(f"{where}; it may use {', '.join(sorted(allowed))}")
    return problems


def _cpp_allowed(path: Path, header: str, allowed: set[str]) -> bool:
    for folder in allowed - {"generated"}:
        base = ROOT / folder
        candidates = [
            base / header,
            base / "include" / header,
            *(p / "include" / header for p in base.glob("*")),
        ]
        if any(candidate.is_file() for candidate in candidates):
            return True
        sibling = (path.parent / header).resolve()
        parent = (path.parent.parent / header).resolve()
        if any(p.is_file() and base in p.parents for p in (sibling, parent)):
            return True
    return "generated" in allowed and GENERATED.match(header) is not None


def python_problems() -> list[str]:
    problems = []
    source = ROOT / "python" / "src"
    for path in sorted(source.rglob("*.py")):
        module = ".".join(path.relative_to(source).with_suffix("").parts).removesuffix(".__init__")
        forbidden = next((f for rule, f in PYTHON_RULES.items() if f"{module}.".startswith(f"{rule}.")), set())
        for line, imported in _imports(path):
            top = imported.split(".")[0]
            if top in NOBODY_IMPORTS or any(f"{imported}.".startswith(f"{name}.") for name in forbidden):
                problems.append(f"{path.relative_to(ROOT)}:{line}: {module} must not import {imported}")
    return problems


def _imports(path: Path) -> list[tuple[int, str]]:
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            found += [(node.lineno, f"{node.module}.{alias.name}") for alias in node.names]
    return found


def main() -> int:
    problems = cpp_problems() + python_problems()
    for problem in problems:
        print(problem)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
