"""Finds out what is wrong with a line from its last bytes, and reports only causes with evidence."""

from wirebond.analysis.diagnosis.finding import Diagnosis, Kind
from wirebond.analysis.diagnosis.line import diagnose, diagnose_dump

__all__ = ["Diagnosis", "Kind", "diagnose", "diagnose_dump"]
