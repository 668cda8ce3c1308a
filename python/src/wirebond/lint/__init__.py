"""The lint: what a protocol's file says about the link that it will make, in figures that were measured."""

from wirebond.lint.findings import Finding, Severity
from wirebond.lint.places import Places
from wirebond.lint.report import Report, check

__all__ = ["Finding", "Places", "Report", "Severity", "check"]
