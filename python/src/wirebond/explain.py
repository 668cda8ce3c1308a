"""Explain every byte of a frame from a program. See docs/explain.md."""

from wirebond.analysis.explain import Applied, Changes, Explanation, FittingGuess, Kind, Row, State, Stretch, explain

__all__ = ["Applied", "Changes", "Explanation", "FittingGuess", "Kind", "Row", "State", "Stretch", "explain"]
