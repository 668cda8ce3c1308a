"""``wirebond soak``: runs, shows the progress, and reports the result for a person or as JSON."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from wirebond import paths
from wirebond.cli.output import errors, write
from wirebond.cli.signals import ended_by_signals
from wirebond.cli.values import to_json
from wirebond.codec import Codec, load
from wirebond.errors import UsageError
from wirebond.sim.faults import verify_baud
from wirebond.sim.soak.plots import NOT_INSTALLED, draw
from wirebond.sim.soak.report import is_good, markdown, verdicts
from wirebond.sim.soak.run import BATCH, Progress, Settings, run
from wirebond.whole_file import write_whole

_MOST_MINUTES = 300.0  # the MCU counts bytes in 32 bits, and a line of 2 Mbaud fills these in six hours and a half
_MOST_LOAD = 20.0


def soak_protocol(path: Path | None, load_text: str, settings: Settings, as_json: bool, report: Path | None) -> int:
    """Run a soak. Returns 1 if a frame is not accounted for, an intact one was lost, or one waited for too long;
    otherwise 0."""
    settings = replace(settings, load=_load_of(load_text))
    _verify(settings)
    with ended_by_signals():
        result = _run(load(path or paths.protocols() / "enterprize.yaml"), settings)
    if report is not None:
        plots = draw(result, report)
        write_whole(report, markdown(result, plots, "" if plots else NOT_INSTALLED))
    if as_json:
        write(to_json(result) + "\n")
    else:
        write("\n".join(verdicts(result)) + "\n" if report is not None else markdown(result))
    return 0 if is_good(result) else 1


def _load_of(text: str) -> float | None:
    if text == "seed":
        return None
    try:
        load = float(text)
    except ValueError:
        load = 0.0
    if not 0.01 <= load <= _MOST_LOAD:
        raise UsageError(f"--load {text}: expected 0.01 to {_MOST_LOAD:g} times the capacity of the line, or `seed`")
    return load


def _verify(settings: Settings) -> None:
    if not 0 < settings.minutes <= _MOST_MINUTES:
        raise UsageError(f"--minutes {settings.minutes:g}: expected more than 0, and {_MOST_MINUTES:g} at most")
    if settings.jitter and not settings.virtual:
        raise UsageError("--jitter is for the simulated adapter of --virtual; add --virtual")
    if settings.jitter > BATCH:
        raise UsageError(f"--jitter {settings.jitter * 1e3:g}: expected at most {BATCH * 1e3:g} ms, the adapter's turn")
    if settings.unplugs and not settings.virtual:
        raise UsageError("--unplug is for the simulated adapter of --virtual; add --virtual")
    settings.verify()
    if settings.baud is not None:
        verify_baud(settings.baud)


def _run(codec: Codec, settings: Settings) -> dict[str, Any]:
    """Run with a progress bar on a terminal."""
    if not sys.stderr.isatty():
        return run(codec, settings)
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[told]}"), TimeRemainingColumn())
    with Bar(*columns, console=errors, transient=True) as bar:
        task = bar.add_task(f"soak of {codec.name}", total=settings.minutes * 60, told="compiling")

        def show(progress: Progress) -> None:
            speedup = progress.virtual_seconds / max(progress.seconds, 1e-9)
            told = f"{progress.virtual_seconds / 60:.1f} of {settings.minutes:g} min, {speedup:.0f} times real time"
            bar.update(task, completed=progress.virtual_seconds, told=told)

        return run(codec, settings, show)
