"""A first protocol file for bytes of an unknown format, from a program. See docs/infer.md."""

from wirebond.analysis.infer import Inference, infer

__all__ = ["Inference", "infer"]
