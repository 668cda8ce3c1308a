"""The overload experiment of ``wirebond soak``: both ends of a link offer more than the line carries, for long."""

from wirebond.sim.soak.mix import Mix, mix_of
from wirebond.sim.soak.run import Progress, Settings, build, run

__all__ = ["Mix", "Progress", "Settings", "build", "mix_of", "run"]
