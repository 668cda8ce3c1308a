"""Compiles the programs that put the send queue to the test."""

from __future__ import annotations

import os
import subprocess
import tempfile
from pathlib import Path

from wirebond import paths

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).parent
BUILD = ROOT / "build" / "concurrency"
COMMON = ("-std=c++17", "-g1", "-Wall", "-Wextra", "-Werror", "-Wshadow", "-Wconversion", "-pthread")
PLAIN = ("-O2",)  # as the engine is built
# Not all of `undefined`, and doctest's small assertions: with the rest the compiler takes twice as long.
SANITIZE = (
    "-O1", "-fsanitize=address,shift,bounds,signed-integer-overflow", "-fno-sanitize-recover=all",
    "-DDOCTEST_CONFIG_SUPER_FAST_ASSERTS",
)  # fmt: skip
THREAD_SANITIZE = ("-O1", "-fsanitize=thread")
# Relacy brings its own `operator delete`, but not the one that is told a size; and warnings of its own.
RELACY = ("-std=c++17", "-O1", "-w", "-pthread", "-fno-sized-deallocation")


def build(name: str, sources: tuple[str, ...], flags: tuple[str, ...], common: tuple[str, ...] = COMMON) -> Path:
    """The program of these files of this folder, made again where one of them, or a header, is newer.

    Several processes may ask for the same one at once. AssertionError with the compiler's words where it does not
    compile.
    """
    program = BUILD / name
    made_from = [path for folder in (HERE, paths.core_include()) for path in folder.rglob("*.[ch]pp")]
    if program.exists() and program.stat().st_mtime > max(
        path.stat().st_mtime for path in [*made_from, Path(__file__)]
    ):
        return program
    BUILD.mkdir(parents=True, exist_ok=True)
    handle, started = tempfile.mkstemp(dir=BUILD, prefix=name)
    os.close(handle)
    files = [str(HERE / source) for source in sources]
    command = ["c++", *common, *flags, f"-I{paths.core_include()}", *files, "-o", started]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr[-4000:]
    Path(started).replace(program)  # whoever runs the old one keeps it
    return program


def stress(flags: tuple[str, ...] = PLAIN, name: str = "stress") -> Path:
    """Threads that send into a queue as fast as they can; stress.cpp says how it is called."""
    return build(name, ("stress.cpp",), flags)
