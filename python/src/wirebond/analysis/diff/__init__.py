"""Finds out what a changed protocol file breaks: compares two protocols, at each end and in each direction."""

from wirebond.analysis.diff.change import Change, Effect, Flow, Verdict
from wirebond.analysis.diff.compare import Comparison, compare

__all__ = ["Change", "Comparison", "Effect", "Flow", "Verdict", "compare"]
