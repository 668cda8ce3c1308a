"""The overload experiment of ``wirebond soak``: both ends of a link offer more than the line carries, for long."""

from wirebond.soak.mix import Mix, mix_of
from wirebond.soak.run import Progress, Settings, build, run

__all__ = ["Mix", "Progress", "Settings", "build", "mix_of", "run"]
