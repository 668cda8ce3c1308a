"""The simulated rover: building its firmware for this machine, to run it as a process on a pty."""

from __future__ import annotations

from pathlib import Path

from wirebond import paths
from wirebond.codec import load
from wirebond.generate.code import generate_cpp
from wirebond.sim.build import Program, cache, compile_once, shipped
from wirebond.sim.process import FirmwareProcess

NAME = "rover"


def protocol_file() -> Path:
    """Return the protocol that the rover speaks."""
    return paths.protocols() / "diffdrive.yaml"


def program(generated: Path) -> Program:
    """Return its program.

    :param generated: the folder that the code of its protocol is generated into.
    """
    generate_cpp(load(protocol_file()).model, generated)
    firmware = paths.firmware()
    includes = [generated, firmware, firmware / "rover", paths.posix_include()]
    return Program("the rover", NAME, firmware / "rover" / "host" / "main.cpp", includes)


def build(folder: Path | None = None) -> Path:
    """Return the compiled rover: the one that came with the package; without one it is compiled, once for its sources.

    :param folder: compile it in this folder, whatever came with the package.
    :raises WirebondError: there is no C++ compiler, or it fails.
    """
    if folder is None:
        ready = shipped(NAME)
        if ready is not None:
            return ready
        folder = cache(NAME)
    return compile_once(program(folder / "generated"), folder)


class RoverProcess(FirmwareProcess):
    """A running rover. Its lines: ``estop on``, ``estop off``, ``charge on``, ``charge off``, and ``pose``: then it
    reports where its body is (x, y and heading, from the speeds of the wheels and not from ticks)."""

    def __init__(self, program: Path) -> None:
        super().__init__(program, "the rover")
