"""The simulated rover: building its firmware for this machine, and running it as a process on a pty."""

from __future__ import annotations

import hashlib
import os
import queue
import shlex
import shutil
import subprocess
import threading
from pathlib import Path
from types import TracebackType
from typing import Self

from wirebond import paths
from wirebond.codec import load
from wirebond.codegen import generate_cpp
from wirebond.errors import UsageError, WirebondError

_START_TIMEOUT = 10.0  # seconds


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
        for base in (generated, paths.firmware() / "rover", paths.posix_include())
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
        *compiler, "-std=c++17", "-O2", "-pthread", f"-I{generated}", f"-I{paths.firmware() / 'rover'}",
        f"-I{paths.posix_include()}", str(paths.firmware() / "rover" / "host" / "main.cpp"), "-o", str(unfinished),
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


class RoverProcess:
    """A running rover. ``port`` is its tty; ``events`` are the lines that it reports. Ends with its ``with`` block,
    or with this process, however that ends."""

    def __init__(self, program: Path) -> None:
        self._process = subprocess.Popen(
            [str(program), "--end-with-stdin"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
            start_new_session=True,  # Ctrl-C in the terminal is for us
        )
        self._lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._collect, daemon=True).start()
        try:
            self.port = self._lines.get(timeout=_START_TIMEOUT)
        except queue.Empty:
            self.close()
            raise WirebondError("the rover did not start") from None
        if not self.port:
            raise WirebondError("the rover ended at once; the system may have no pty left")

    def _collect(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line.strip())
        self._lines.put("")

    def events(self, timeout: float = 0.0) -> list[str]:
        """Lines such as ``12.345 stop`` since the last call; waits up to ``timeout`` seconds for the first."""
        lines: list[str] = []
        try:
            lines.append(self._lines.get(timeout=timeout) if timeout > 0 else self._lines.get_nowait())
            while True:
                lines.append(self._lines.get_nowait())
        except queue.Empty:
            return [line for line in lines if line]

    def tell(self, line: str) -> None:
        """``estop on``, ``estop off``, ``charge on`` or ``charge off``."""
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def close(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(timeout=2)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
