"""Compiling a C++ program of the simulator for this machine, once for each state of its sources."""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from wirebond import paths
from wirebond.errors import UsageError, WirebondError

_FLAGS = ("-std=c++17", "-O2", "-pthread")


@dataclass(frozen=True)
class Program:
    """A C++ program of the simulator.

    :ivar what: names it in sentences.
    :ivar name: names it in folders.
    :ivar includes: all C++ files below these folders are its sources, as those beside ``main`` are.
    """

    what: str
    name: str
    main: Path
    includes: Sequence[Path]

    def command(self, compiler: Sequence[str], out: Path) -> list[str]:
        """Return the command line that compiles it.

        :param compiler: the compiler with its own options, such as those for another machine.
        :param out: where the program is written.
        """
        return [*compiler, *_FLAGS, *(f"-I{path}" for path in self.includes), str(self.main), "-o", str(out)]


def shipped(name: str) -> Path | None:
    """Return the program of this name that came with the package: its wheel has it, a source tree does not.

    :param name: its name in the folder.
    """
    program = paths.PROGRAMS / name
    return program if program.exists() else None


def compile_once(program: Program, folder: Path) -> Path:
    """Return the compiled program, in ``folder``; it is compiled unless one of the same sources exists.

    :param program: what is compiled.
    :param folder: keeps it, with those of other states of the sources.

    The compiler is ``$CXX``, with ``$CXXFLAGS``.

    :raises UsageError: there is no C++ compiler, or this is not Linux.
    :raises WirebondError: it fails.
    """
    if sys.platform != "linux":
        raise UsageError(f"{program.what} is a program for Linux alone; run it there, or on Windows in WSL")
    sources = sorted(path for base in (*program.includes, program.main.parent) for path in base.rglob("*.[ch]pp"))
    compiler = [*shlex.split(os.environ.get("CXX", "c++")), *shlex.split(os.environ.get("CXXFLAGS", ""))]
    digest = hashlib.sha256(" ".join([*compiler, *_FLAGS]).encode())
    for path in sources:
        digest.update(path.read_bytes())
    compiled = folder / f"{program.name}-{digest.hexdigest()[:16]}"
    if compiled.exists():
        return compiled
    if shutil.which(compiler[0]) is None:
        raise UsageError(
            f"{program.what} is compiled on first use, and there is no {compiler[0]}; install a C++ compiler (g++)"
        )
    unfinished = compiled.with_suffix(f".{os.getpid()}")
    result = subprocess.run(program.command(compiler, unfinished), capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise WirebondError(f"{program.what} does not compile with {compiler[0]}:\n{result.stderr.strip()[:2000]}")
    unfinished.replace(compiled)
    return compiled


def cache(name: str) -> Path:
    """Return this user's folder for such programs."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    folder = Path(base) / "wirebond" / name
    folder.mkdir(parents=True, exist_ok=True)
    return folder
