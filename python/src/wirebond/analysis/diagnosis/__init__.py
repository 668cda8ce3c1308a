"""What is wrong with a line, in words: by its last bytes, and only where they speak for it."""

from wirebond.analysis.diagnosis.finding import Diagnosis, Kind
from wirebond.analysis.diagnosis.line import diagnose, diagnose_dump

__all__ = ["Diagnosis", "Kind", "diagnose", "diagnose_dump"]
