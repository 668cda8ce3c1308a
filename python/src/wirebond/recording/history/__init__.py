"""What a link or a recording brought, kept as columns: newest values, frames, least and greatest per pixel."""

from wirebond.recording.history.history import History

__all__ = ["History"]
