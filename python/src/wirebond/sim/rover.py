"""The simulated rover: building its firmware for this machine, to run it as a process on a pty."""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
from pathlib import Path

from wirebond import paths
from wirebond.codec import load
from wirebond.errors import UsageError, WirebondError
from wirebond.gen import generate_cpp
from wirebond.sim.process import FirmwareProcess


def protocol_file() -> Path:
    """The protocol that the rover speaks."""
    return paths.protocols() / "diffdrive.yaml"


def build(folder: Path | None = None) -> Path:
    """Compile the rover, unless a program from the same sources is there already; the program's path.

    :raises WirebondError: there is no C++ compiler, or it fails.
    """
    folder = folder or _cache()
    generated = folder / "generated"
    generate_cpp(load(protocol_file()).model, generated)
    sources = sorted(
        path
        for base in (generated, paths.firmware() / "rover", paths.firmware() / "host", paths.posix_include())
        for path in base.rglob("*.[ch]pp")
    )
    compiler = shlex.split(os.environ.get("CXX", "c++"))
    digest = hashlib.sha256(" ".join(compiler).encode())
    for path in sources:
        digest.update(path.read_bytes())
    program = folder / f"rover-{digest.hexdigest()[:16]}"
    if program.exists():
        return program
    if shutil.which(compiler[0]) is None:
        raise UsageError(
            f"the rover is compiled on first use, and there is no {compiler[0]}; install a C++ compiler (g++)"
        )
    unfinished = program.with_suffix(f".{os.getpid()}")
    command = [
        *compiler, "-std=c++17", "-O2", "-pthread", f"-I{generated}", f"-I{paths.firmware()}",
        f"-I{paths.firmware() / 'rover'}", f"-I{paths.posix_include()}",
        str(paths.firmware() / "rover" / "host" / "main.cpp"), "-o", str(unfinished),
    ]  # fmt: skip
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise WirebondError(f"the rover does not compile with {compiler[0]}:\n{result.stderr.strip()[:2000]}")
    unfinished.replace(program)
    return program


def _cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    folder = Path(base) / "wirebond" / "rover"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


class RoverProcess(FirmwareProcess):
    """A running rover. Its lines: ``estop on``, ``estop off``, ``charge on`` and ``charge off``."""

    def __init__(self, program: Path) -> None:
        super().__init__(program, "the rover")
