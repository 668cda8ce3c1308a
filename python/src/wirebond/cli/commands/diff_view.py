"""Shows a comparison to a person: which ends understand each other, then the changes."""

from __future__ import annotations

from collections.abc import Callable

from wirebond.analysis.diff.change import Change, Verdict, end_name
from wirebond.analysis.diff.compare import Comparison
from wirebond.cli.output import console, plain
from wirebond.protocol.model import End

_STYLE = {Verdict.BREAKS: "bold red", Verdict.COMPATIBLE: "bold yellow", Verdict.HARMLESS: "bold green"}


def print_comparison(old: str, new: str, found: Comparison, place_of: Callable[[Change], str]) -> None:
    """Print a comparison. ``place_of`` gives a change's place in its file, as ``robot.yaml:12:3``."""
    numbers = [f"{n} {_VERBS[v][n != 1]}" for v in Verdict if (n := found.number_of(v))]
    console.print(plain(f"{old} to {new}: {', '.join(numbers) or 'no change'}"), soft_wrap=True)
    for end in (End.HOST, End.MCU):
        other = End.MCU if end == End.HOST else End.HOST
        verdict = "works" if found.works(end) else "breaks"
        style = "green" if found.works(end) else "bold red"
        console.print(f"  new {end_name(end)} with old {end_name(other)}: [{style}]{verdict}[/]")
    for change in found.changes:
        line = f"{place_of(change)} {change.what}: {change.sentence}"
        console.print(f"\n[{_STYLE[change.verdict]}]{change.verdict}[/]: {plain(line)}", soft_wrap=True)
        for effect in change.effects:
            mark = "" if effect.breaks or change.verdict != Verdict.BREAKS else "works: "
            console.print(f"  [dim]{plain(str(effect.flow))}[/]: {plain(mark + effect.sentence)}", soft_wrap=True)


_VERBS = {
    Verdict.BREAKS: ("change breaks the link", "changes break the link"),
    Verdict.COMPATIBLE: ("is compatible", "are compatible"),
    Verdict.HARMLESS: ("is harmless", "are harmless"),
}
