"""A check that no catalogue lists, worked out from frames that have it. Bytes in, an algorithm out."""

from wirebond.analysis.explain.solve.sample import LEAST_SAMPLES, Sample
from wirebond.analysis.explain.solve.solution import Solution, solve

__all__ = ["LEAST_SAMPLES", "Sample", "Solution", "solve"]
