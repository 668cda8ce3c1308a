"""The simulated rover: building its firmware for this machine, to run it as a process on a pty."""

from __future__ import annotations

from pathlib import Path

from wirebond import paths
from wirebond.codec import load
from wirebond.generate.code import generate_cpp
from wirebond.sim.build import cache, compile_once
from wirebond.sim.process import FirmwareProcess


def protocol_file() -> Path:
    """The protocol that the rover speaks."""
    return paths.protocols() / "diffdrive.yaml"


def build(folder: Path | None = None) -> Path:
    """Compile the rover, unless a program from the same sources is there already; the program's path.

    :raises WirebondError: there is no C++ compiler, or it fails.
    """
    folder = folder or cache("rover")
    generated = folder / "generated"
    generate_cpp(load(protocol_file()).model, generated)
    firmware = paths.firmware()
    includes = [generated, firmware, firmware / "rover", paths.posix_include()]
    return compile_once("the rover", "rover", firmware / "rover" / "host" / "main.cpp", includes, folder)


class RoverProcess(FirmwareProcess):
    """A running rover. Its lines: ``estop on``, ``estop off``, ``charge on``, ``charge off``, and ``pose``: then it
    reports where its body is (x, y and heading, from the speeds of the wheels and not from ticks)."""

    def __init__(self, program: Path) -> None:
        super().__init__(program, "the rover")
