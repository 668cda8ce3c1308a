"""An explanation as data, for programs. Pure."""

from __future__ import annotations

from typing import Any

from wirebond.analysis.explain.report import Explanation, Stretch


def explanation_dict(explanation: Explanation) -> dict[str, Any]:
    """Return the explanation as a dictionary. Bytes stay bytes; a writer of JSON makes them hex."""
    return {
        "protocol": explanation.protocol,
        "sender": explanation.sender,
        "stretches": [_stretch(stretch) for stretch in explanation.stretches],
        "together": [vars(guess) for guess in explanation.together],
        "discarded_bytes": explanation.discarded_bytes,
        "rejected_candidates": explanation.rejected_candidates,
    }


def _stretch(stretch: Stretch) -> dict[str, Any]:
    out = {name: value for name, value in vars(stretch).items() if value not in ("", (), {})}
    out["rows"] = [vars(row) for row in stretch.rows]
    out["rules"] = [vars(rule) for rule in stretch.rules]
    out["guesses"] = [vars(guess) for guess in stretch.guesses]
    return out
