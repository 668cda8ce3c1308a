"""Building the benchmarks' C++ programs, and counting their instructions."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import wirebond
from bench.collateral import PROTOCOL
from bench.figures import ROOT
from wirebond import paths
from wirebond.generate.code import generate_cpp

BUILD = ROOT / "build" / "bench"
POSIX = ROOT / "ports" / "posix" / "include"
FLAGS = ["-std=c++17", "-O2", "-Wall", "-Wextra", "-Werror"]  # as the engine is built


def build(name: str, protocol: Path = PROTOCOL, *includes: Path) -> Path:
    """``bench/<name>.cpp``, compiled beside the generated header of the protocol: by default the benchmarks' own.
    ``includes``: more folders of headers."""
    generated = BUILD / "generated"
    generate_cpp(wirebond.load(protocol).model, generated)
    program = BUILD / name
    source = Path(__file__).with_name(f"{name}.cpp")
    command = [
        "c++",
        *FLAGS,
        f"-I{generated}",
        f"-I{paths.core_include()}",
        *(f"-I{folder}" for folder in (POSIX, *includes)),
        str(source),
        "-o",
        str(program),
    ]
    subprocess.run(command, check=True)
    return program


def instructions(command: list[str]) -> int:
    """Callgrind's count of one run."""
    valgrind = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
    result = subprocess.run([*valgrind, *command], capture_output=True, text=True, check=True)
    counted = re.search(r"Collected : (\d+)", result.stderr)
    assert counted is not None, result.stderr
    return int(counted.group(1))
