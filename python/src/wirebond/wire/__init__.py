"""Two ptys joined by a simulated wire in real time, as a process."""

from wirebond.wire.process import WireProcess, WireSettings

__all__ = ["WireProcess", "WireSettings"]
