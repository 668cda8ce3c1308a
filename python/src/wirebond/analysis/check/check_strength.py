"""Measures how many damaged frames a format's checks accept, on the protocol's own frames with its own decoder.

Two receivers are measured. The protocol's own knows its messages: a damaged id or size is often refused for that alone.
The open receiver takes any id and any size, as firmware does that looks only at header, check and tail; it gets the
reference mix, random payloads of 9, 12, 6, 26, 13 and 40 bytes, so that formats can be compared with each other.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from wirebond.analysis.check.damage import (
    Fault,
    Measured,
    bit_error_rate,
    burst,
    measure,
    weights_by_damage,
    wrong_bits,
)
from wirebond.analysis.check.findings import Finding, Severity
from wirebond.analysis.check.frame_facts import ANY, ANY_CONTENT, forms, open_protocol, payload_sizes, senders
from wirebond.analysis.check.places import Places
from wirebond.analysis.check.wording import count, percent
from wirebond.analysis.samples import Pool, pool
from wirebond.codec import Codec
from wirebond.protocol.meaning.messages import spoken
from wirebond.protocol.model import CheckKind, End, PartKind, PayloadRule, Protocol
from wirebond.protocol.model.forms import parts_of_forms

RULE = "check-strength"
REFERENCE_MIX = (9, 12, 6, 26, 13, 40)  # payload bytes
BIT_ERROR_RATE = 1e-4  # a bad line, where nearly every damaged frame has one wrong bit

# A burst is a run of up to this many bits, the first and the last wrong, the others by chance.
FAULTS: dict[str, Fault] = {
    "1 bit": wrong_bits(1),
    "2 bits": wrong_bits(2),
    "3 bits": wrong_bits(3),
    "8-bit burst": burst(8),
    "16-bit burst": burst(16),
    "32-bit burst": burst(32),
}
FEW_BITS = ("1 bit", "2 bits", "3 bits")
_CONTENTS = 6000  # random payloads of each size: fewer would show in the share's last digit
_WEAK = 0.01  # from here on a warning, where one to three wrong bits are concerned
_IMPERFECT = 0.0005  # from here on a note; a CRC of 16 bits stays far below


@dataclass(frozen=True)
class Strength:
    """Accepted shares by fault; ``reference`` is None if the frame does not give a payload's size by itself."""

    faults: dict[str, Measured]
    bit_errors: Measured
    reference: Measured | None

    def as_dict(self) -> dict[str, Any]:
        rows = {**self.faults, "bit errors": self.bit_errors}
        if self.reference is not None:
            rows["bit errors, reference mix"] = self.reference
        return {
            "bit_error_rate": BIT_ERROR_RATE,
            "reference_mix_payload_bytes": list(REFERENCE_MIX),
            "accepted": {
                name: {"samples": m.samples, "accepted": m.accepted, "share": m.share, "at_most": m.at_most}
                for name, m in rows.items()
            },
        }


def measure_strength(codec: Codec, samples: int, seed: int) -> Strength:
    """Measure with ``samples`` damaged frames for each kind of fault. All messages have equal weight, whichever end
    sends them."""
    pools = [found for end in senders(codec.model) if (found := pool(codec, end, seed))]
    frames = sum(len(each.frames) for each in pools)

    def over_pools(fault: Fault, rate: float | None = None) -> Measured:
        total = Measured(0, 0)
        done = 0
        for each in pools:
            before, done = done, done + len(each.frames)
            part = samples * done // frames - samples * before // frames
            weights = None if rate is None else weights_by_damage(each, rate)
            total += measure(each, fault, part, seed, weights)
        return total

    return Strength(
        {name: over_pools(fault) for name, fault in FAULTS.items()},
        over_pools(bit_error_rate(BIT_ERROR_RATE), BIT_ERROR_RATE),
        _reference(codec.model, 2 * samples, seed),
    )


def _reference(protocol: Protocol, samples: int, seed: int) -> Measured | None:
    sender = senders(protocol)[0]
    possible = payload_sizes(forms(protocol, sender)[0], 255)
    sizes = [size for size in REFERENCE_MIX if possible is None or size in possible]
    model = open_protocol(protocol, sender, max(possible, default=0) if possible is not None else max(REFERENCE_MIX))
    if model is None or not sizes:
        return None
    part = model.format.part(PartKind.PAYLOAD)
    assert part is not None, "every frame has a payload part"
    if part.payload == PayloadRule.FIXED:
        sizes = [part.fixed_payload]
    generator = random.Random(seed)  # noqa: S311  (to measure, not to keep secrets)
    codec = Codec(model)
    contents = [generator.randbytes(size) for size in sizes for _ in range(_CONTENTS)]
    frames = tuple(codec.encode(ANY, {ANY_CONTENT: content} if content else {}) for content in contents)
    open_pool = Pool(codec, sender, frames)
    weights = weights_by_damage(open_pool, BIT_ERROR_RATE)
    return measure(open_pool, bit_error_rate(BIT_ERROR_RATE), samples, seed, weights)


def assess(protocol: Protocol, strength: Strength, places: Places) -> list[Finding]:
    """Return at most one finding: the relevant figures, and why this check lets damaged frames pass."""
    frame_format = protocol.format
    place = places.part("check")
    few = {name: strength.faults[name].share for name in FEW_BITS}
    weakest = max(measured.share for measured in strength.faults.values())
    if weakest < _IMPERFECT:
        return []
    severity = Severity.WARNING if max(few.values()) >= _WEAK else Severity.NOTE
    shown = few if severity == Severity.WARNING else {name: m.share for name, m in strength.faults.items()}
    rows = [
        f"{percent(share)} with {name} wrong" if name in FEW_BITS else f"{percent(share)} with a {name}"
        for name, share in shown.items()
        if share
    ]
    sentence = f"the receiver accepts damaged frames: {', '.join(rows)}"
    if strength.reference is not None and strength.reference.share >= _WEAK:
        mix = "/".join(str(size) for size in REFERENCE_MIX)
        part = frame_format.part(PartKind.PAYLOAD)
        if part is not None and part.payload != PayloadRule.FIXED:
            sentence += (
                f"; one that takes any id and size accepts {percent(strength.reference.share)} of those damaged where "
                f"1 bit in {count(1 / BIT_ERROR_RATE)} is wrong (payloads of {mix} random bytes)"
            )
    return [
        Finding(
            RULE,
            severity,
            sentence,
            _reason(protocol),
            "if the format is yours to change, take `check: crc-16/ibm-sdlc`; if not, give every field a `range`, and "
            "act on no single message that could do harm",
            place.line,
            place.column,
        )
    ]


def _reason(protocol: Protocol) -> str:
    frame_format = protocol.format
    checks = [part for part in frame_format.parts if part.kind == PartKind.CHECK]
    has_each_a_check = all(form.checks for end in senders(protocol) for form in forms(protocol, end))
    if checks and not has_each_a_check:
        return "the check is there only when a bit of the header says so: a wrong bit there gives a frame without it"
    if not checks:
        return "the frame has no check: only its constant bytes and sizes refuse anything"
    part = checks[-1]
    algorithm = part.algorithm
    assert algorithm is not None, "a check has an algorithm"
    if algorithm.kind == CheckKind.SUM and part.shift:
        return "only the high byte of a sum is sent: most wrong bits change only the low byte, so they go unnoticed"
    if algorithm.kind == CheckKind.SUM:
        units = "bytes" if algorithm.unit == 1 else "words"
        return f"in a sum two errors of opposite sign cancel, and the order of {units} does not matter"
    if algorithm.kind == CheckKind.XOR:
        units = "bytes" if algorithm.unit == 1 else "words"
        return f"in an exclusive-or two wrong bits at the same place of two {units} cancel"
    if algorithm.kind == CheckKind.FLETCHER:
        return (
            "Fletcher's sums are weak against errors close together, and some of them do not distinguish 0x00 from 0xFF"
        )
    bits = min(part.check_bits, algorithm.kept.bit_count())
    if bits < 16:
        return f"a check of {bits} bits agrees by chance with 1 in {count(2**bits)} damaged frames"
    return "this check does not suit these frames: they are too long for it, or part of them is not covered"


_EFFECTS: dict[str, str] = {
    PartKind.ID: "one wrong bit there turns a message into another one, or into none",
    PartKind.LENGTH: "one wrong bit there makes the receiver look for the check in a wrong place",
    PartKind.PAYLOAD: "no wrong value in it is ever noticed",
}


def uncovered(protocol: Protocol, places: Places) -> list[Finding]:
    """Find parts that carry meaning and that no check covers, in frames that have one."""
    ends = senders(protocol)
    found: dict[tuple[str, str], list[End]] = {}
    for end in ends:
        for what in dict.fromkeys(_uncovered_from(protocol, end)):
            found.setdefault(what, []).append(end)
    place = places.part("check")
    return [
        Finding(
            "uncovered-part",
            Severity.WARNING,
            f"no check covers the {what}" + ("" if from_ends == ends else f" of the {spoken(from_ends[0])}'s frames"),
            _EFFECTS[what],
            f"if the format is yours to change, let `over:` include `{name}`",
            place.line,
            place.column,
        )
        for (what, name), from_ends in found.items()
    ]


def _uncovered_from(protocol: Protocol, end: End) -> Iterator[tuple[str, str]]:
    """Yield each uncovered part's kind and name, in the order of the frame."""
    for form in parts_of_forms(protocol.format.parts, end):
        checks = [part for part in form.parts if part.kind == PartKind.CHECK]
        covered = {index for check in checks for index in check.covered}
        for index, part in enumerate(form.parts):
            for what in (part.kind.value, *(run.role.value for run in part.bits)):
                if checks and what in _EFFECTS and index not in covered:
                    yield what, part.name
