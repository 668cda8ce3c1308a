"""Naming every byte of a frame, and finding out why bytes were refused. Needs no engine, no port, no clock."""

from wirebond.analysis.explain.explanation import explain
from wirebond.analysis.explain.report import Applied, Changes, Explanation, FittingGuess, Kind, Row, State, Stretch

__all__ = ["Applied", "Changes", "Explanation", "FittingGuess", "Kind", "Row", "State", "Stretch", "explain"]
