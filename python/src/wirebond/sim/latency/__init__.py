"""Measures the latency of a link: `measure.py` asks and times, `figures.py` makes percentiles, `plot.py` draws."""

from wirebond.sim.latency.figures import Figures, figures, histogram
from wirebond.sim.latency.measure import Measurement, Probe, measure, probe_for

__all__ = ["Figures", "Measurement", "Probe", "figures", "histogram", "measure", "probe_for"]
