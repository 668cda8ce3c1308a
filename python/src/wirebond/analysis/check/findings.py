"""The result of a rule: a sentence with its figure, the reason, what to do, and the place in the file."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any


class Severity(StrEnum):
    """Worst first. An error cannot work; a warning will hurt on some day; a note is worth a thought."""

    ERROR = "error"
    WARNING = "warning"
    NOTE = "note"

    @property
    def rank(self) -> int:
        return list(Severity).index(self)


@dataclass(frozen=True)
class Finding:
    """One thing that a rule found. ``line`` and ``column`` count from 1; both are 0 where no place is known."""

    rule: str
    severity: Severity
    sentence: str
    reason: str
    remedy: str
    line: int = 0
    column: int = 0

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)


def worst_first(findings: list[Finding]) -> tuple[Finding, ...]:
    """Sort by severity, then by place."""
    return tuple(sorted(findings, key=lambda f: (f.severity.rank, f.line, f.column, f.rule)))
