"""A stand-in for Windows: this process loses what Python does not have there, and then runs commands.

    python -m tests.like_windows '[["check", "protocols/diffdrive.yaml"]]'

Which modules and names those are, the types of the standard library say (typeshed, which is a part of mypy). It is no
Windows: paths, files and processes stay those of Linux. Libraries are loaded before, because their own code for Windows
would need it; so it shows only what Wirebond itself does.
"""

from __future__ import annotations

import ast
import contextlib
import importlib
import io
import json
import os
import pathlib
import selectors
import socket
import subprocess
import sys
from collections.abc import Iterator
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import mypy
import serial
from serial import serialposix

STDLIB = Path(mypy.__file__).parent / "typeshed" / "stdlib"
NEWEST_WITHOUT = (3, 12)  # the oldest Python of the wheel for Windows: later ones there have a few names more
LIBRARIES = (
    *("asyncio", "concurrent.futures.thread", "getpass", "logging.handlers", "mimetypes", "multiprocessing"),
    *("platform", "shutil", "subprocess", "tempfile", "uuid", "webbrowser", "wsgiref.handlers"),
    *("jinja2", "lz4.frame", "msgspec", "numpy", "numpy.testing", "pycparser.c_parser", "pydantic", "rich.live"),
    *("rich.progress", "rich.table", "ruamel.yaml", "serial.rfc2217", "starlette.applications", "typer"),
    *("typer.rich_utils", "uvicorn", "uvicorn.protocols.http.h11_impl", "uvicorn.lifespan.on", "websockets.server"),
    "zstandard",
)
PORTS = "PORTS_LIKE_WINDOWS"  # in the environment: what COM3 and others lead to, as JSON
ENGINE = ("Link", "port_latency_us")  # what it has only with ports of its own


def names(module: Path, platform: str) -> set[str]:
    """The public names of a module of the standard library on this system."""
    return set(_defined(ast.parse(module.read_text(encoding="utf-8")).body, platform))


def _defined(body: list[ast.stmt], platform: str) -> Iterator[str]:
    for node in body:
        match node:
            case ast.If():
                system = SimpleNamespace(platform=platform, version_info=NEWEST_WITHOUT)
                try:
                    holds = eval(ast.unparse(node.test), {"sys": system})
                except (NameError, AttributeError):
                    holds = True
                yield from _defined(node.body if holds else node.orelse, platform)
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                yield node.name
            case ast.AnnAssign(target=ast.Name(name)):
                yield name
            case ast.Assign():
                yield from (target.id for target in node.targets if isinstance(target, ast.Name))
            case ast.ImportFrom():
                yield from (alias.asname or alias.name for alias in node.names)


def missing_names(module: str) -> set[str]:
    """Names that this module has here and not on Windows."""
    stub = STDLIB / f"{module}.pyi"
    stub = stub if stub.exists() else STDLIB / module / "__init__.pyi"
    return {name for name in names(stub, "linux") - names(stub, "win32") if not name.startswith("__")}


def missing_modules() -> set[str]:
    """Modules of the standard library that are empty on Windows. The types say too little of the first ones."""
    found = {"termios", "curses", "_curses", "_posixshmem"}
    for stub in STDLIB.glob("*.pyi"):
        if "win32" not in stub.read_text(encoding="utf-8"):
            continue
        imported = set(_imported(stub))
        here, there = (names(stub, system) - imported for system in ("linux", "win32"))
        if here and not here & there:
            found.add(stub.stem)
    return found


def _imported(stub: Path) -> Iterator[str]:
    """Names that are there for the types alone."""
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            yield from (alias.asname or alias.name for alias in node.names)


class _Refuses(MetaPathFinder):
    """Finds no module that Windows does not have, and the engine without its ports."""

    def __init__(self, modules: set[str]) -> None:
        self._modules = modules

    def find_spec(self, name: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        if name in self._modules:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        if name != "wirebond._engine":
            return None
        for finder in sys.meta_path:
            found = None if finder is self else finder.find_spec(name, path, target)
            if found is not None and found.loader is not None:
                found.loader = _WithoutPorts(found.loader)
                return found
        return None


class _WithoutPorts(Loader):
    def __init__(self, loader: Any) -> None:
        self._loader = loader

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return self._loader.create_module(spec)  # type: ignore[no-any-return]

    def exec_module(self, module: ModuleType) -> None:
        self._loader.exec_module(module)
        for name in ENGINE:
            delattr(module, name)


def become() -> None:
    """From here on this process is like one on Windows."""
    for library in LIBRARIES:
        importlib.import_module(library)
    assert not [name for name in sys.modules if name.split(".")[0] == "wirebond"]
    pair, unix = socket.socketpair, socket.AF_UNIX
    for module in (subprocess, serialposix):  # what Linux needs to do what they do on Windows
        for name in ("os", "select", "signal"):
            if name in vars(module):
                setattr(module, name, SimpleNamespace(**vars(sys.modules[name])))
    refused = missing_modules()
    for name in refused:
        sys.modules.pop(name, None)
    sys.meta_path.insert(0, _Refuses(refused))
    for name in ("os", "signal", "socket", "select", "mmap", "time", "subprocess", "asyncio", "threading"):
        module = sys.modules[name]
        for missing in missing_names(name):
            module.__dict__.pop(missing, None)
    socket.socketpair = lambda *_: pair(unix)  # type: ignore[misc,assignment] of TCP there
    subprocess.CREATE_NEW_PROCESS_GROUP = 0  # type: ignore[misc] Linux takes no other
    selectors.DefaultSelector = selectors.SelectSelector  # type: ignore[misc]
    subprocess._PopenSelector = selectors.SelectSelector  # type: ignore[attr-defined]
    pathlib.WindowsPath = pathlib.PosixPath  # type: ignore[misc,assignment] what Path() makes where os.name is nt
    serial.serial_for_url = _com_port
    sys.platform = "win32"
    os.name = "nt"


class _ComPort(serialposix.Serial):
    """As pyserial's port on Windows, which has no descriptor."""

    def fileno(self) -> int:
        raise io.UnsupportedOperation("fileno")


def _com_port(name: str, **options: Any) -> _ComPort:
    """Open a port as pyserial does: names are those of `PORTS`, and lead to ttys."""
    assert "exclusive" not in options  # there every port is
    path = json.loads(os.environ.get(PORTS, "{}")).get(name)
    if path is None or not Path(path).exists():
        raise serial.SerialException(f"could not open port {name!r}: FileNotFoundError(2, 'no such file', None, 2)")
    return _ComPort(path, **options)


def run(commands: list[list[str]]) -> list[tuple[int, str]]:
    """Exit code and output of each command, in one process.

    :param commands: the words behind ``wirebond``.
    """
    from wirebond.cli.main import main  # noqa: PLC0415 it is loaded on Windows

    found = []
    for command in commands:
        with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(out):
            code = main(command)
        found.append((code, out.getvalue()))
    return found


if __name__ == "__main__":
    become()
    print(json.dumps(run(json.loads(sys.argv[1]))))
