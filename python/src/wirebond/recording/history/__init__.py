"""Keeps the data of a link or a recording as columns: newest values, frames, minimum and maximum per pixel."""

from wirebond.recording.history.history import History

__all__ = ["History"]
