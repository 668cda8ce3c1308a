"""Connects Wirebond and a real program on one machine: ptys, a cable, a device as a process."""

from __future__ import annotations

import os
import select
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import wirebond
from tests.compilers import CXX
from tests.contrib.cases import CONTRIB
from tests.shared import ROOT
from wirebond.generate.code import generate_cpp
from wirebond.sim.process import FirmwareProcess
from wirebond.sim.pty_port import PtyPort

FLAGS = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-Wshadow", "-Wconversion", "-O0", "-pthread"]
PEERS = Path(__file__).parent


@contextmanager
def cable() -> Iterator[tuple[str, str]]:
    """Two ttys: what is written to one is read from the other."""
    ends = (PtyPort(), PtyPort())
    stop_read, stop_write = os.pipe()

    def carry() -> None:
        while True:
            ready, _, _ = select.select([*ends, stop_read], [], [])
            if stop_read in ready:
                return
            for here, there in (ends, ends[::-1]):
                if here in ready:
                    there.write(here.read(0))

    thread = threading.Thread(target=carry, daemon=True)
    thread.start()
    try:
        yield ends[0].path, ends[1].path
    finally:
        os.write(stop_write, b"x")
        thread.join()
        for descriptor in (stop_read, stop_write):
            os.close(descriptor)
        for end in ends:
            end.close()


@contextmanager
def device(name: str, folder: Path) -> Iterator[str]:
    """The tty of a device of device.hpp that speaks ``protocols/contrib/<name>.yaml``."""
    protocol = wirebond.load(CONTRIB / f"{name}.yaml").model
    generate_cpp(protocol, folder)
    includes = [folder, PEERS, ROOT / "firmware", ROOT / "ports" / "posix" / "include"]
    program = folder / "device"
    command = [CXX, *FLAGS, *(f"-I{path}" for path in includes)]
    command += [f'-DLINK_HEADER="{name}_link.hpp"', f"-DDEVICE_{name.partition('_')[0].upper()}=1"]
    done = subprocess.run(
        [*command, str(PEERS / "device_main.cpp"), "-o", str(program)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    with FirmwareProcess(program, name) as process:
        yield process.port
