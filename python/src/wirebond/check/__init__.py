"""The lint: what a protocol's file says about the link that it will make, in figures that were measured."""

from wirebond.check.findings import Finding, Severity
from wirebond.check.places import Places
from wirebond.check.report import Report, lint

__all__ = ["Finding", "Places", "Report", "Severity", "lint"]
