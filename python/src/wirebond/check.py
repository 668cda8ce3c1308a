"""Lint a protocol file from a program. See docs/check.md."""

from wirebond.analysis.check import Finding, Places, Report, Severity, lint

__all__ = ["Finding", "Places", "Report", "Severity", "lint"]
