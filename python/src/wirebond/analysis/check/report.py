"""Applies all rules to one protocol: the findings, worst first, and every figure they are based on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from wirebond.analysis.check import (
    check_strength,
    cut_frames,
    examples,
    given,
    holdback,
    identity,
    line_budget,
    noise,
    schedule,
    shared_line,
    stamps,
    stuffing,
)
from wirebond.analysis.check import urgent_wait as urgent
from wirebond.analysis.check.check_strength import Strength
from wirebond.analysis.check.findings import Finding, Severity, worst_first
from wirebond.analysis.check.fixed_end import suited
from wirebond.analysis.check.frame_bounds import FrameBound, frame_bounds
from wirebond.analysis.check.frame_facts import senders
from wirebond.analysis.check.holdback import HoldBack
from wirebond.analysis.check.line_budget import Budget
from wirebond.analysis.check.noise import Noise
from wirebond.analysis.check.places import Places
from wirebond.analysis.check.stuffing import InsertedZero
from wirebond.analysis.check.urgent_wait import UrgentWait
from wirebond.analysis.samples import asked
from wirebond.codec import Codec

SEED = 1
_SAMPLES = 40_000  # damaged frames for each kind of fault
_NOISE_BYTES = 8_000_000  # for each direction
_THOROUGH = 20  # times as many


@dataclass(frozen=True)
class Report:
    """The result of the lint for one protocol. ``findings`` are sorted, worst first."""

    findings: tuple[Finding, ...]
    strength: Strength
    noise: tuple[Noise, ...]
    budgets: tuple[Budget, ...]
    hold_backs: tuple[HoldBack, ...]
    urgent_waits: tuple[UrgentWait, ...]
    frame_bounds: tuple[FrameBound, ...]
    inserted_zero: InsertedZero | None
    examples: int
    seed: int

    def number_of(self, severity: Severity) -> int:
        return sum(finding.severity == severity for finding in self.findings)

    def as_dict(self) -> dict[str, Any]:
        """Return the findings and all figures for JSON: rates in SI units, shares from 0 to 1."""
        zero = self.inserted_zero
        return {
            "findings": [finding.as_dict() for finding in self.findings],
            "figures": {
                "seed": self.seed,
                "check_strength": self.strength.as_dict(),
                "noise": {each.sender.value: each.as_dict() for each in self.noise},
                "line": {each.sender.value: each.as_dict() for each in self.budgets},
                "hold_back": {each.sender.value: each.as_dict() for each in self.hold_backs},
                "urgent_wait": {each.sender.value: each.as_dict() for each in self.urgent_waits},
                "largest_frame": {each.sender.value: each.as_dict() for each in self.frame_bounds},
                "inserted_zero": None if zero is None else zero.as_dict(),
                "examples": self.examples,
            },
        }


def lint(
    codec: Codec,
    places: Places | None = None,
    *,
    traffic: str | None = None,
    thorough: bool = False,
    seed: int = SEED,
) -> Report:
    """Run every rule. The same seed gives the same figures. Takes about a second; ``thorough`` some twenty.

    ``traffic``: a load to assess instead of the file's schedule, such as ``gimbal_cmd=2000,mcu:47=3992`` (frames a
    second by message, or by sender and bytes on the wire).

    :raises UsageError: ``traffic`` cannot be read.
    """
    model = codec.model
    where = places or Places()
    loads = line_budget.scheduled_loads(model) if traffic is None else line_budget.parse_traffic(model, traffic)
    more = _THOROUGH if thorough else 1
    budgets = line_budget.budgets(model, loads)
    measured = asked(codec)
    strength = check_strength.measure_strength(measured, _SAMPLES * more, seed)
    noises = [noise.measure_noise(measured, end, _NOISE_BYTES * more, seed) for end in senders(model)]
    hold_backs = holdback.directions(measured, seed)
    waits = [urgent.urgent_wait(model, budget) for budget in budgets]
    zero = stuffing.measure_inserted_zero(measured, seed)
    findings = [
        *examples.assess(codec, where),
        *given.assess(codec, where),
        *cut_frames.assess(measured, seed, where),
        *line_budget.assess(model, budgets, where),
        *shared_line.assess(model, budgets, where),
        *([] if stuffing.explains_damage(model, zero) else check_strength.assess(model, strength, where)),
        *check_strength.uncovered(model, where),
        *noise.assess(model, noises, where),
        *stuffing.assess(model, zero, where),
        *holdback.assess(model, hold_backs, where),
        *urgent.assess(model, waits, where),
        *schedule.assess_deadlines(model, where),
        *schedule.assess_safety(model, where),
        *stamps.assess(model, where),
        *identity.assess_ids(model, where),
        *identity.assess_magic(model, where),
    ]
    return Report(
        worst_first(suited(model, findings)),
        strength,
        tuple(noises),
        tuple(budgets),
        tuple(hold_backs),
        tuple(waits),
        tuple(frame_bounds(model)),
        zero,
        len(model.examples),
        seed,
    )
