"""From bytes of an unknown format to a first protocol file: how frames are cut, and which check they have."""

from wirebond.analysis.infer.inference import Inference, infer

__all__ = ["Inference", "infer"]
