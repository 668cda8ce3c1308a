"""False frames in random bytes: counted with the decoder, and worked out where counting finds none."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wirebond.analysis.check.damage import decode_blocks
from wirebond.analysis.check.findings import Finding, Severity
from wirebond.analysis.check.frame_facts import forms, payload_sizes
from wirebond.analysis.check.places import Places
from wirebond.analysis.check.wording import count, direction
from wirebond.analysis.samples import Pool
from wirebond.codec import Codec
from wirebond.protocol.model import End, Message, PayloadRule, Protocol, Stuffing
from wirebond.protocol.plan import Form, Number

RULE = "false-frames"
_CHUNK = 4_000_000  # bytes at once
_FEWER = 50  # times, where silence ends frames: each block is decoded by itself, which is slow
_TOO_MANY = 1.0  # false frames a million bytes
_LONGEST_SEGMENT = 4096  # random bytes between two zeros are longer with a chance of e^-16


@dataclass(frozen=True)
class Noise:
    """A direction. ``expected`` is worked out from the format, a million bytes; None where no formula is at hand."""

    sender: End
    bytes: int
    frames: int
    expected: float | None

    @property
    def measured(self) -> float:
        """False frames a million bytes."""
        return self.frames / self.bytes * 1e6

    @property
    def at_most(self) -> float:
        """If none was found: the rate that 95 % of such measurements stay below (rule of three)."""
        return self.measured if self.frames else 3 / self.bytes * 1e6

    @property
    def best(self) -> float:
        """The measured rate, or the computed one if nothing was found."""
        return self.measured if self.frames else self.expected or 0.0

    def as_dict(self) -> dict[str, Any]:
        return {
            "random_bytes": self.bytes,
            "false_frames": self.frames,
            "per_million_bytes": self.measured,
            "per_million_bytes_at_most": self.at_most,
            "per_million_bytes_expected": self.expected,
        }


def measure_noise(codec: Codec, sender: End, size: int, seed: int) -> Noise:
    """Decode about ``size`` random bytes as if this end had sent them.

    Where silence ends a frame they come in blocks of 1 byte to as many as the longest frame has, and they are fewer.
    """
    generator = np.random.default_rng(seed)
    rate = expected_rate(codec.model, sender)
    expected = None if rate is None else 1e6 * rate
    if codec.model.format.ends_by_silence:
        longest = codec.model.max_wire_bytes(sender=sender)
        lengths = generator.integers(1, longest + 1, 2 * size // _FEWER // longest + 1)
        blocks = (generator.bytes(int(length)) for length in lengths)
        frames = sum(decode_blocks(Pool(codec, sender, ()), blocks))
        return Noise(sender, int(lengths.sum()), frames, expected)
    frames = done = 0
    while done < size:
        data = generator.integers(0, 256, min(_CHUNK, size - done), dtype=np.uint8)
        frames += codec.decode_columns(data.tobytes(), sender).stats.frames
        done += len(data)
    return Noise(sender, done, frames, expected)


# ---- worked out


def expected_rate(protocol: Protocol, sender: End) -> float | None:
    """Return the false frames for each random byte: the chance that constants, id, size and checks all fit.

    None for escapes, hex digits and insertions, delimiters around bytes that are not stuffed, silence, and checks in
    hex digits.
    """
    frame_format = replace(protocol.format, max_payload=protocol.format.max_payload_from(sender), longest_sent=())
    protocol = replace(protocol, format=frame_format)
    possible = forms(protocol, sender)
    if frame_format.ends_by_silence or any(rule.as_hex for form in possible for rule in form.checks):
        return None
    messages = [message for message in protocol.messages if message.sent_by(sender)]
    if frame_format.delimiter is None and not frame_format.is_sized:
        return sum(_constants_and_checks(form) * _id_and_size(protocol, form, messages) for form in possible)
    if frame_format.stuffing != Stuffing.COBS or frame_format.opening != frame_format.delimiter:
        return None
    return sum(_constants_and_checks(form) * _cobs(protocol, form, messages) for form in possible)


def _constants_and_checks(form: Form) -> float:
    bits = sum(constant.mask.bit_count() for constant in form.constants)
    return 2.0 ** -(bits + sum(rule.bits for rule in form.checks))


def _sizes(form: Form, message: Message) -> tuple[int, int]:
    """Return the minimum and maximum payload of this message on the wire."""
    return 0 if form.trims_zeros else message.min_payload, message.max_payload


def _chance(number: Number | None) -> float:
    """Return the chance that random bits make one certain number."""
    return 1.0 if number is None else 1 / (number.mask + 1)


def _id_and_size(protocol: Protocol, form: Form, messages: list[Message]) -> float:
    possible = payload_sizes(form, protocol.format.max_payload)
    by_length = form.payload == PayloadRule.BY_LENGTH and possible is not None
    one_size = _chance(form.length)
    if protocol.format.deliver_unknown:
        return len(possible) * one_size if by_length and possible is not None else 1.0
    fitting = 0.0
    for message in messages:
        least, greatest = _sizes(form, message)
        known = 1.0
        if by_length and possible is not None:
            known = sum(least <= size <= greatest for size in possible) * one_size
        fitting += known * _chance(form.id)
    return min(1.0, fitting)


def _cobs(protocol: Protocol, form: Form, messages: list[Message]) -> float:
    """Return the chance per random byte that it is a zero and the nonzero bytes before it are a possible result of
    COBS."""
    fixed = form.prefix + form.suffix
    longest = min(_LONGEST_SEGMENT, fixed + protocol.format.max_payload + 1)
    valid = [1.0]  # by length: the chance that this many nonzero bytes are a chain of COBS blocks
    total = 0.0
    for length in range(1, longest + 1):
        valid.append(sum(valid[max(0, length - 255) :]) / 255)
        payload = length - 1 - fixed
        if payload < 0:
            continue
        fits = 1.0
        if not protocol.format.deliver_unknown:
            sizes = [_sizes(form, message) for message in messages]
            fits = sum(least <= payload <= greatest for least, greatest in sizes) * _chance(form.id)
        total += (255 / 256) ** length * valid[length] * fits
    return total / 256 / 256  # a zero before it and one after it


# ---- the finding


def assess(protocol: Protocol, noise: list[Noise], places: Places) -> list[Finding]:
    """Assess the worse direction: a finding if random bytes yield frames often."""
    worst = max(noise, key=lambda each: each.best)
    if worst.best <= _TOO_MANY:
        return []
    place = places.at("frame")
    byte_rate = protocol.link.baud / protocol.link.bits_per_byte
    return [
        Finding(
            RULE,
            Severity.WARNING,
            f"random bytes yield {worst.best:.3g} false frames a million ({direction(worst.sender)}): one every "
            f"{count(1e6 / worst.best)} bytes",
            f"an open input or a wrong baud rate brings such bytes, up to {count(byte_rate)} a second on this line",
            "take a check of 16 bits or more, a longer magic, or a tail",
            place.line,
            place.column,
        )
    ]
