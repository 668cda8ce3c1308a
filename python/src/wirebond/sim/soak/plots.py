"""Pictures of a soak's result, where matplotlib is installed."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from wirebond.sim.soak.report import DIRECTIONS

NOT_INSTALLED = "There are no plots: matplotlib is not installed (`pip install matplotlib`)."


def draw(result: dict[str, Any], report: Path) -> list[str]:
    """Write ``<report>-latency.svg`` beside the report. Return the file names of the pictures; empty: there is no
    matplotlib."""
    try:
        drawing = importlib.import_module("matplotlib.figure")
    except ImportError:
        return []
    figure = drawing.Figure(figsize=(7, 4))
    axes = figure.add_subplot()
    for name, title in DIRECTIONS:
        curve = result[name]["latency_curve"]
        axes.plot([us / 1000 for _, us in curve], [100 * share for share, _ in curve], label=title)
    axes.set_xscale("log")
    axes.set_xlabel("from accepted to delivered, ms")
    axes.set_ylabel("% of frames")
    axes.grid(visible=True, alpha=0.3)
    axes.legend()
    picture = report.with_name(f"{report.stem}-latency.svg")
    figure.savefig(picture, bbox_inches="tight")
    return [picture.name]
