"""The register that computes a check: the plan's description of an algorithm for the engine and generated code."""

from __future__ import annotations

from dataclasses import replace

from wirebond.protocol.model import Algorithm, CheckKind

_BYTE = 8  # bits


def register_of(algorithm: Algorithm) -> tuple[Algorithm, int]:
    """Return the algorithm that runs, and how far to the right its value is to be shifted.

    A CRC of fewer than eight bits runs in a register of eight, at its upper end: its polynomial, times a power of x,
    leaves the same remainder times that power.
    """
    spare = _BYTE - algorithm.width
    if algorithm.kind != CheckKind.CRC or spare <= 0:
        return algorithm, 0
    shift = 0 if algorithm.refout else spare  # reflection brings the value to the lower end
    return (
        replace(
            algorithm,
            width=_BYTE,
            poly=algorithm.poly << spare,
            init=algorithm.init << spare,
            xorout=algorithm.xorout << shift,
            plus=algorithm.plus << shift,
            mask=algorithm.kept << shift,  # a carry out of the narrow value is dropped
            avoided=tuple((low << shift, high << shift) for low, high in algorithm.avoided),
            avoided_plus=algorithm.avoided_plus << shift,
        ),
        shift,
    )
