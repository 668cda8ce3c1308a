"""Shows a lint report to a person: the findings, worst first, then a line for each figure."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Protocol, TypeVar

from wirebond.analysis.check import Finding, Report, Severity
from wirebond.analysis.check.check_strength import BIT_ERROR_RATE, Strength
from wirebond.analysis.check.damage import Measured
from wirebond.analysis.check.frame_bounds import FrameBound
from wirebond.analysis.check.holdback import HoldBack
from wirebond.analysis.check.line_budget import Budget
from wirebond.analysis.check.noise import Noise
from wirebond.analysis.check.wording import count, direction, percent, plural, rate, seconds
from wirebond.cli.output import console, plain
from wirebond.codec import Codec
from wirebond.protocol.model import End

_STYLE = {Severity.ERROR: "bold red", Severity.WARNING: "bold yellow", Severity.NOTE: "bold cyan"}
_WIDEST = 110  # columns; longer lines are hard to read
_LABEL = 24  # columns of a figure's label
_NO_BREAK = "\u00a0"
_NUMBER_AND_UNIT = re.compile(r"(?<=\d) (?=\d{3}\b|%|ms\b|us\b|s\b|MB\b|bits?\b|bytes?\b)")


def print_report(path: Path, codec: Codec, report: Report) -> None:
    head = f"{path}: protocol {codec.name}, {plural(len(codec.model.messages), 'message')}, hash {codec.hash:016x}"
    numbers = [plural(n, severity.value) for severity in Severity if (n := report.number_of(severity))]
    console.print(plain(f"{head}: {', '.join(numbers) or 'no problem found'}"), soft_wrap=True)
    for finding in report.findings:
        _print_finding(path, finding)
    console.print("\n[bold]figures[/]")
    for label, text in _figures(report):
        _print_wrapped(f"  {label:{_LABEL}}", text)


def _print_finding(path: Path, finding: Finding) -> None:
    place = f"{path}:{finding.line}:{finding.column}" if finding.line else str(path)
    style = _STYLE[finding.severity]
    console.print(f"\n[{style}]{finding.severity}[/]: {plain(place)} [dim]{finding.rule}[/]", soft_wrap=True)
    _print_wrapped("  ", finding.sentence[:1].upper() + finding.sentence[1:])
    _print_wrapped("  why  ", finding.reason)
    _print_wrapped("  do   ", finding.remedy)


def _print_wrapped(label: str, text: str) -> None:
    """Print with a hanging indent under the label; a number and its unit stay on one line."""
    lines = textwrap.wrap(
        _NUMBER_AND_UNIT.sub(_NO_BREAK, text),
        max(40, min(_WIDEST, console.width) - len(label)),
        break_long_words=False,
        break_on_hyphens=False,
    )
    for index, line in enumerate(lines):
        before = f"[dim]{plain(label)}[/]" if index == 0 else " " * len(label)
        console.print(before + plain(line.replace(_NO_BREAK, " ")), soft_wrap=True)


# ---- figures: a label and a line each


def _figures(report: Report) -> Iterator[tuple[str, str]]:
    yield from _strength(report.strength)
    if report.inserted_zero is not None:
        yield "inserted zero accepted", _share(report.inserted_zero.own)
    yield "false frames in noise", _both(report.noise, _noise_text)
    yield "line", _both(report.budgets, _budget_text)
    yield "false start holds back", _both(report.hold_backs, _hold_back_text)
    yield "largest frame", _both(report.frame_bounds, _frame_bound_text)
    yield "urgent frame waits", _both(report.urgent_waits, lambda wait: f"up to {seconds(wait.seconds)}")
    if report.examples:
        yield "worked examples", f"{report.examples} compared"


def _strength(strength: Strength) -> Iterator[tuple[str, str]]:
    rows = {**strength.faults, f"1 bit in {count(1 / BIT_ERROR_RATE)}": strength.bit_errors}
    accepted = [f"{name}: {percent(measured.share)}" for name, measured in rows.items() if measured.accepted]
    never = [measured for measured in rows.values() if not measured.accepted]
    if never:
        least = min(measured.samples for measured in never)
        of_what = f"none of {count(least)}"
        of_what += " with each other fault" if accepted else " with 1, 2 or 3 wrong bits or a burst of up to 32"
        accepted.append(f"{of_what} (< {percent(max(measured.at_most for measured in never))})")
    yield "damaged frames accepted", ", ".join(accepted)
    if strength.reference is not None and strength.reference.accepted:
        yield (
            "by any id, any size",
            f"{_share(strength.reference)} of the reference mix, 1 bit in {count(1 / BIT_ERROR_RATE)} wrong",
        )


class _OneWay(Protocol):
    @property
    def sender(self) -> End: ...


_Row = TypeVar("_Row", bound=_OneWay)


def _both(rows: Sequence[_Row], text_of: Callable[[_Row], str]) -> str:
    """Return a clause for each direction, or one for both where they say the same."""
    texts = [text_of(row) for row in rows]
    if len(rows) > 1 and len(set(texts)) == 1:
        return f"{texts[0]}, both ways"
    return "; ".join(f"{direction(row.sender)} {text}" for row, text in zip(rows, texts, strict=True))


def _share(measured: Measured) -> str:
    return percent(measured.share) if measured.accepted else f"none (< {percent(measured.at_most)})"


def _noise_text(noise: Noise) -> str:
    found = count(noise.frames) if noise.frames else "none"
    worked_out = "" if noise.expected is None else f" (worked out: {noise.expected:.2g} a MB)"
    return f"{found} in {count(noise.bytes / 1e6)} MB{worked_out}"


def _budget_text(budget: Budget) -> str:
    busiest = budget.busiest
    if busiest is None:
        return "nothing scheduled"
    return f"{percent(budget.share)} taken, room for {rate(budget.greatest_rate(busiest))} of {busiest.name}"


def _frame_bound_text(bound: FrameBound) -> str:
    return f"{bound.wire_bytes} bytes, the receiver works in {bound.workspace_bytes}"


def _hold_back_text(found: HoldBack) -> str:
    if found.checked:
        return "none: the header has its own check"
    bound = f"{found.bytes} bytes, {seconds(found.seconds)}" if found.bytes else "none"
    if found.unbounded_bytes is None or found.unbounded_seconds is None:
        return bound
    return f"{bound} (without max_payload {found.unbounded_bytes} bytes, {seconds(found.unbounded_seconds)})"
