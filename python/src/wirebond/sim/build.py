"""Compiling a C++ program of the simulator for this machine, once for each state of its sources."""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from wirebond.errors import UsageError, WirebondError


def compile_once(what: str, name: str, main: Path, includes: Sequence[Path], folder: Path) -> Path:
    """The program of ``main``, in ``folder``; it is compiled unless one of the same sources is there.

    :param what: names it in sentences.
    :param name: names it in the folder.
    :param includes: all C++ files below these folders are its sources.

    The compiler is ``$CXX``, with ``$CXXFLAGS``.

    :raises UsageError: there is no C++ compiler.
    :raises WirebondError: it fails.
    """
    sources = sorted(path for base in (*includes, main.parent) for path in base.rglob("*.[ch]pp"))
    compiler = shlex.split(os.environ.get("CXX", "c++"))
    flags = ["-std=c++17", "-O2", "-pthread", *shlex.split(os.environ.get("CXXFLAGS", ""))]
    digest = hashlib.sha256(" ".join([*compiler, *flags]).encode())
    for path in sources:
        digest.update(path.read_bytes())
    program = folder / f"{name}-{digest.hexdigest()[:16]}"
    if program.exists():
        return program
    if shutil.which(compiler[0]) is None:
        raise UsageError(
            f"{what} is compiled on first use, and there is no {compiler[0]}; install a C++ compiler (g++)"
        )
    unfinished = program.with_suffix(f".{os.getpid()}")
    command = [*compiler, *flags, *(f"-I{path}" for path in includes)]
    result = subprocess.run([*command, str(main), "-o", str(unfinished)], capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise WirebondError(f"{what} does not compile with {compiler[0]}:\n{result.stderr.strip()[:2000]}")
    unfinished.replace(program)
    return program


def cache(name: str) -> Path:
    """This user's folder for such programs."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    folder = Path(base) / "wirebond" / name
    folder.mkdir(parents=True, exist_ok=True)
    return folder
