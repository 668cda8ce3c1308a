"""Defines a measured figure; prints and stores figures."""

from __future__ import annotations

import enum
import json
import os
import platform
import subprocess
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from wirebond.whole_file import write_whole

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
LATEST = HERE / "latest.json"


# Units of what is counted: no other program changes such a figure.
COUNTED = {
    "bytes", "frames", "frames and bytes", "instructions", "MB", "messages", "probes", "restarts",
    "% of 170 MHz (computed)", "% of what is allowed",
}  # fmt: skip


class Verdict(enum.Enum):
    YES = "[green]yes[/]"
    NO = "[bold red]no[/]"
    NOT_JUDGED = "[yellow]not judged[/]"  # the machine was not quiet


@dataclass(frozen=True)
class Figure:
    """``goal`` is a bound: ``at_most`` says whether from above or from below. None: the figure stands beside others."""

    key: str
    value: float
    unit: str
    goal: float | None
    command: str
    at_most: bool = True

    @property
    def met(self) -> bool:
        if self.goal is None:
            return True
        return self.value <= self.goal if self.at_most else self.value >= self.goal

    def verdict(self, noises: str = "") -> Verdict:
        """``noises``: why the machine was not quiet; empty if it was."""
        if self.met:
            return Verdict.YES
        return Verdict.NOT_JUDGED if noises and self.unit not in COUNTED else Verdict.NO


def show(title: str, figures: list[Figure], noises: str = "") -> None:
    table = Table(title=title, title_justify="left", title_style="bold")
    for name in ("figure", "value", "unit", "goal", "met"):
        table.add_column(name, justify="right" if name in ("value", "goal") else "left")
    for figure in figures:
        bound = "≤" if figure.at_most else "≥"
        goal = ("", "") if figure.goal is None else (f"{bound} {figure.goal:,.6g}", figure.verdict(noises).value)
        table.add_row(figure.key, f"{figure.value:,.6g}", figure.unit, *goal)
    console = Console()
    console.print(table)
    if noises:
        console.print(f"The machine was not quiet: {noises}.")


def keep(figures: list[Figure], noises: str = "") -> None:
    """Merge into latest.json, so that a run of one benchmark keeps the others' figures."""
    kept = json.loads(LATEST.read_text()) if LATEST.exists() else {}
    for figure in figures:
        row = {name: getattr(figure, name) for name in ("value", "unit", "goal", "command")}
        kept[figure.key] = (
            row | {"verdict": figure.verdict(noises).name.lower()} | ({"noises": noises} if noises else {})
        )
    write_whole(LATEST, json.dumps(dict(sorted(kept.items())), indent=2) + "\n")
    write_whole(LATEST.with_name("latest_machine.json"), json.dumps(machine(), indent=2) + "\n")


def machine() -> dict[str, str]:
    """Describe the machine of the measurements."""
    model = next(
        (
            line.partition(":")[2].strip()
            for line in Path("/proc/cpuinfo").read_text().splitlines()
            if line.startswith("model name")
        ),
        platform.machine(),
    )
    commit = subprocess.run(
        ["git", "-C", str(ROOT), "describe", "--always", "--dirty"],
        capture_output=True,
        text=True,
        check=False,
    ).stdout.strip()
    compiler = subprocess.run(["c++", "--version"], capture_output=True, text=True, check=True).stdout.splitlines()[0]
    return {
        "processor": model,
        "cores": str(os.cpu_count()),
        "system": platform.platform(terse=True),
        "python": platform.python_version(),
        "compiler": compiler,
        "commit": commit,
    }
