"""Finds the known format of a line by the evidence of its bytes."""

from wirebond.analysis.identify.formats import Format, Known, format_of, known_formats
from wirebond.analysis.identify.ranking import FITS, Candidate, rank

__all__ = ["FITS", "Candidate", "Format", "Known", "format_of", "known_formats", "rank"]
