"""The lint: what a protocol's file says about the link that it will make, in figures that were measured."""

from wirebond.analysis.check.findings import Finding, Severity
from wirebond.analysis.check.places import Places
from wirebond.analysis.check.report import Report, lint

__all__ = ["Finding", "Places", "Report", "Severity", "lint"]
