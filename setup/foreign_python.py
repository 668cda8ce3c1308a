"""Describe the Python of Windows or macOS to CMake, so that the engine is compiled for it on Linux.

The extension keeps to the stable interface of CPython 3.12, so three things are enough:

- Headers: those of a CPython 3.12 or newer of this computer, with `setup/foreign/pyconfig.h` in the place of their own.
- For Windows the import library of `python3.dll`, made from the names of the stable interface: no other name links.
- For macOS nothing more: the interpreter that loads the extension has the names.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from abi3info import DATAS, FUNCTIONS

PYCONFIG = Path(__file__).resolve().parent / "foreign" / "pyconfig.h"
ZIG = (sys.executable, "-m", "ziglang")
OLDEST = (3, 12)  # that the extension works with


@dataclass(frozen=True)
class ForeignTarget:
    """A kind of computer whose Python does not run here.

    :ivar name: for people.
    :ivar system: as CMake names it.
    :ivar processor: as CMake names it.
    :ivar zig: as the compiler names it, with the oldest system that the extension works with.
    :ivar python_platform: as Python names it; the wheel's tag follows from it.
    :ivar suffix: of the extension's file.
    """

    name: str
    system: str
    processor: str
    zig: str
    python_platform: str
    suffix: str

    @property
    def is_windows(self) -> bool:
        """Return whether it is Windows; otherwise it is macOS."""
        return self.system == "Windows"


FOREIGN_TARGETS = (
    ForeignTarget("windows-x86_64", "Windows", "AMD64", "x86_64-windows-gnu", "win-amd64", ".pyd"),
    ForeignTarget("macos-arm64", "Darwin", "arm64", "aarch64-macos.11.0", "macosx-11.0-arm64", ".abi3.so"),
    ForeignTarget("macos-x86_64", "Darwin", "x86_64", "x86_64-macos.11.0", "macosx-11.0-x86_64", ".abi3.so"),
)


@dataclass(frozen=True)
class ForeignPython:
    """The facts that a build needs.

    :ivar arguments: of `cmake`.
    :ivar environment: of `pip wheel`, beside `CMAKE_ARGS` with the arguments.
    """

    arguments: tuple[str, ...]
    environment: dict[str, str]


def foreign_python(target: ForeignTarget, headers: Path, folder: Path) -> ForeignPython:
    """Write the toolchain, the headers and the import library.

    :param headers: the include folder of a CPython 3.12 or newer of this computer.
    :param folder: for what is written; its contents are replaced.
    :returns: what CMake and pip need to be given.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    include = foreign_headers(headers, folder)
    arguments = {
        "CMAKE_TOOLCHAIN_FILE": toolchain(target, folder),
        "Python_INCLUDE_DIR": include,
        "WIREBOND_ENGINE_PORTS": "OFF",
    }
    if target.is_windows:
        library = import_library(folder)
        arguments |= {"Python_LIBRARY": library, "Python_SABI_LIBRARY": library}
    return ForeignPython(
        tuple(f"-D{name}={value}" for name, value in arguments.items()),
        {"_PYTHON_HOST_PLATFORM": target.python_platform, "SETUPTOOLS_EXT_SUFFIX": target.suffix},
    )


def foreign_headers(headers: Path, folder: Path) -> Path:
    """Copy the headers, with the foreign `pyconfig.h`.

    :param headers: the include folder of a CPython of this computer.
    :param folder: where the copy is made.
    :returns: the copy.
    """
    include = folder / "include"
    shutil.copytree(headers, include)
    shutil.copy(PYCONFIG, include / "pyconfig.h")
    return include


def stable_names() -> Iterator[tuple[str, bool]]:
    """Return the names of the stable interface of CPython 3.12, and whether each one is data."""
    for table, is_data in ((FUNCTIONS, False), (DATAS, True)):
        for symbol, about in table.items():
            if (about.added.major, about.added.minor) <= OLDEST:
                yield symbol.name, is_data


def import_library(folder: Path) -> Path:
    """Make the import library of `python3.dll`.

    :param folder: where it is made.
    :returns: the library.
    """
    definition, library = folder / "python3.def", folder / "python3.lib"
    names = sorted(f"  {name}{' DATA' if is_data else ''}" for name, is_data in stable_names())
    definition.write_text("\n".join(["LIBRARY python3.dll", "EXPORTS", *names, ""]), encoding="ascii")
    command = [*ZIG, "dlltool", "-m", "i386:x86-64", "-D", "python3.dll", "-d", definition, "-l", library]
    subprocess.run(command, check=True)
    return library


def toolchain(target: ForeignTarget, folder: Path) -> Path:
    """Write CMake's description of the compiler.

    :param target: for which it compiles.
    :param folder: where the file and the compiler's commands are written.
    :returns: the file.
    """
    tools = {
        "C_COMPILER": _script(folder / "cc", (*ZIG, "cc", "-target", target.zig)),
        "CXX_COMPILER": _script(folder / "c++", (*ZIG, "c++", "-target", target.zig)),
        "AR": _script(folder / "ar", (*ZIG, "ar")),
        "RANLIB": _script(folder / "ranlib", (*ZIG, "ranlib")),
    }
    if target.is_windows:
        tools["RC_COMPILER"] = _script(folder / "rc", (*ZIG, "rc"))
    lines = [
        f"set(CMAKE_SYSTEM_NAME {target.system})",
        f"set(CMAKE_SYSTEM_PROCESSOR {target.processor})",
        *(f"set(CMAKE_{name} {path})" for name, path in tools.items()),
    ]
    flags = "-s" if target.is_windows else "-undefined dynamic_lookup"
    lines.append(f'set(CMAKE_MODULE_LINKER_FLAGS_INIT "{flags}")')
    file = folder / "toolchain.cmake"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


# The linker of `ziglang` cannot read the file in which nanobind lists Python's names for Apple's linker, and makes no
# bundle; Python loads a library as well.
_FOR_ZIG = """for word; do
  shift
  case $word in
    -Wl,@*) ;;
    -bundle) set -- "$@" -shared ;;
    *) set -- "$@" "$word" ;;
  esac
done
"""


def _script(path: Path, command: Sequence[str]) -> Path:
    """Write a program that is this command with further arguments: CMake wants a compiler to be one file."""
    words = " ".join(f"'{word}'" for word in command)
    path.write_text(f'#!/bin/sh\n{_FOR_ZIG}exec {words} "$@"\n', encoding="utf-8")
    path.chmod(0o755)
    return path
