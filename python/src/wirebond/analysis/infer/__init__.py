"""Writes a first protocol file for bytes of an unknown format: where frames begin and end, and which check they
have."""

from wirebond.analysis.infer.inference import Inference, infer

__all__ = ["Inference", "infer"]
