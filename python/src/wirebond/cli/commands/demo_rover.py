"""The rover's program for ``wirebond demo``."""

from __future__ import annotations

import sys
from pathlib import Path

from wirebond.cli.output import console
from wirebond.sim import rover
from wirebond.sim.build import shipped


def rover_program() -> Path:
    """Return the compiled rover. Compiling takes seconds, so the terminal says it.

    :raises WirebondError: there is no C++ compiler, or it fails.
    :raises UsageError: this is not Linux.
    """
    if shipped(rover.NAME) is None and sys.platform == "linux":
        console.print("building the rover's firmware for this machine …", style="dim")
    return rover.build()
