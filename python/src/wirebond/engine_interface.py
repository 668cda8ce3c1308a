"""Do the compiled engine and the Python code belong together? The engine has two digests of the files that say what one
reads of the other, as these files were when it was built. The build runs this file by itself, so it imports nothing of
the package until something is wrong."""

from __future__ import annotations

import ast
import hashlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

FILES = (
    "_engine.pyi",
    "link/engine_settings.py",
    "protocol/model/fields.py",
    "protocol/model/frames.py",
    "protocol/payload_rules.py",
    "protocol/plan.py",
    "protocol/tables.py",
    "ros2/mapping/packing.py",
)
_PACKAGE = Path(__file__).resolve().parent


def verify(engine: ModuleType) -> None:
    """Verify that engine and package belong together.

    :raises EngineError: the engine was built from other Python code.
    """
    built = getattr(engine, "interface", ("", ""))
    try:
        if _digest_of_bytes(_PACKAGE) == built[0] or digest_of_shapes(_PACKAGE) == built[1]:
            return
    except FileNotFoundError:
        return  # somebody has packed the package without its sources: nothing can be older there
    from wirebond.errors import EngineError  # noqa: PLC0415

    raise EngineError(
        f"the compiled engine ({engine.__file__}) was built from another version of the Python code; run `make setup` "
        "in the repository, or install the package again"
    )


def _digest_of_bytes(package: Path) -> str:
    """Return a digest of the files: equal if none was touched. Takes a fraction of a millisecond."""
    found = hashlib.sha256()
    for name in FILES:
        found.update((package / name).read_bytes())
    return found.hexdigest()


def digest_of_shapes(package: Path) -> str:
    """Return a digest of names and types alone: comments, docstrings and function bodies may change without a new
    engine."""
    lines = [line for name in FILES for line in _shapes((package / name).read_text("utf-8"), name.endswith(".pyi"))]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def _shapes(text: str, with_functions: bool) -> Iterator[str]:
    """Yield the fields of each class, its functions where only their types are there, and the names in tables."""
    parsed = ast.parse(text)
    for node in ast.walk(parsed):
        if isinstance(node, ast.Dict):
            yield from (str(key.value) for key in node.keys if isinstance(key, ast.Constant))
    owners = [("", parsed.body), *((node.name, node.body) for node in parsed.body if isinstance(node, ast.ClassDef))]
    for owner, body in owners:
        for node in body:
            if isinstance(node, ast.FunctionDef) and with_functions:
                yield f"{owner}.{node.name}({ast.unparse(node.args)})"
            elif owner and isinstance(node, ast.AnnAssign):
                yield f"{owner}.{ast.unparse(node.target)}: {ast.unparse(node.annotation)}"
            elif owner and isinstance(node, ast.Assign):
                yield f"{owner}.{ast.unparse(node)}"


def _as_source() -> str:
    """Write C++ that defines both."""
    digests = {"interface_bytes": _digest_of_bytes(_PACKAGE), "interface_shapes": digest_of_shapes(_PACKAGE)}
    lines = ["// Written by engine_interface.py.", "namespace wirebond::engine {"]
    for name, digest in digests.items():
        lines += [f"extern const char* const {name};", f'const char* const {name} = "{digest}";']
    return "\n".join([*lines, "}  // namespace wirebond::engine", ""])


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(_as_source(), "utf-8")
