"""Two ptys joined by a simulated wire in real time, as a process."""

from wirebond.sim.wire.process import LineShape, WireProcess, WireSettings

__all__ = ["LineShape", "WireProcess", "WireSettings"]
