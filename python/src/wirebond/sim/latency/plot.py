"""The picture of a measurement, drawn by matplotlib where that is installed."""

from __future__ import annotations

import importlib
import io
from pathlib import Path
from typing import Any

from wirebond.errors import UsageError
from wirebond.sim.latency.measure import Measurement

FORMATS = (".png", ".svg", ".pdf")


def drawing_for(path: Path) -> Any:
    """Return matplotlib's module of figures.

    :raises UsageError: it is not installed, or it cannot write such a file.
    """
    if path.suffix.lower() not in FORMATS:
        raise UsageError(f"{path} does not end as a picture does; write {path.stem or 'out'}{FORMATS[0]}, or one of "
                         f"{', '.join(FORMATS[1:])}")  # fmt: skip
    try:
        return importlib.import_module("matplotlib.figure")
    except ImportError:
        raise UsageError(
            "--plot needs matplotlib, which is not installed here; install it with `pip install matplotlib`, or leave "
            "out --plot: the histogram is also printed"
        ) from None


def draw(module: Any, title: str, measured: Measurement, kind: str) -> bytes:
    """Return the picture's bytes: how many round trips, and of one way where it was measured, took how long.

    :param module: what `drawing_for` gave.
    :param kind: the format, such as ``png``.
    """
    figure = module.Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.add_subplot()
    series = {"round trip": measured.round_trips, "to the MCU": measured.to_mcu, "to the host": measured.to_host}
    for name, times in series.items():
        if times:
            ordered = sorted(time * 1e3 for time in times)
            above = [1 - rank / len(ordered) for rank in range(len(ordered))]
            axes.step(ordered, above, where="post", label=f"{name} ({len(ordered)})")
    axes.set(title=title, xlabel="time in ms", ylabel="part that took longer", yscale="log")
    axes.grid(visible=True, which="both", alpha=0.3)
    axes.legend()
    picture = io.BytesIO()
    figure.savefig(picture, format=kind)
    return picture.getvalue()
