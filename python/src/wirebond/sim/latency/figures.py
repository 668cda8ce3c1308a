"""Percentiles and histograms of times. Pure arithmetic."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

BINS = 16  # of a histogram


@dataclass(frozen=True)
class Figures:
    """Percentiles of times in seconds. Each is a measured time: the smallest that is not exceeded by that part."""

    count: int
    least: float
    mean: float
    p50: float
    p90: float
    p99: float
    p99_9: float
    most: float


def figures(times: Sequence[float]) -> Figures | None:
    """Compute the figures; None if there are no times."""
    if not times:
        return None
    ordered = sorted(times)

    def percentile(part: float) -> float:
        return ordered[max(math.ceil(part * len(ordered)) - 1, 0)]

    return Figures(
        count=len(ordered),
        least=ordered[0],
        mean=math.fsum(ordered) / len(ordered),
        p50=percentile(0.5),
        p90=percentile(0.9),
        p99=percentile(0.99),
        p99_9=percentile(0.999),
        most=ordered[-1],
    )


def histogram(times: Sequence[float], bins: int = BINS) -> list[tuple[float, float, int]]:
    """Return each bin's bounds and the number of times in it. Bounds grow by one factor, because long times are rare
    and far off; if times are not positive, or nearly equal, by one step."""
    if not times:
        return []
    low, high = min(times), max(times)
    if low == high:
        return [(low, high, len(times))]
    grows = low > 0 and high > 1.5 * low
    if grows:
        edges = [low * (high / low) ** (i / bins) for i in range(bins)] + [high]
    else:
        edges = [low + (high - low) * i / bins for i in range(bins)] + [high]
    counts = [0] * bins
    for time in times:
        share = math.log(time / low) / math.log(high / low) if grows else (time - low) / (high - low)
        counts[min(int(share * bins), bins - 1)] += 1
    return list(zip(edges[:-1], edges[1:], counts, strict=True))
