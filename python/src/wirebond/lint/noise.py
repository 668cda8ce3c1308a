"""False frames in random bytes: counted with the decoder, and worked out where counting finds none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from wirebond.codec import Codec
from wirebond.lint.findings import Finding, Severity
from wirebond.lint.frame_facts import check_bits, fixed_bytes
from wirebond.lint.places import Places
from wirebond.lint.wording import count, direction
from wirebond.protocol.model import End, Frame, Message, PartKind, PayloadRule, Protocol

RULE = "false-frames"
_CHUNK = 4_000_000  # bytes at once
_TOO_MANY = 1.0  # false frames a million bytes
_LONGEST_SEGMENT = 4096  # random bytes between two zeros are longer with a chance of e^-16


@dataclass(frozen=True)
class Noise:
    """One direction. ``expected`` is worked out from the format, a million bytes."""

    sender: End
    bytes: int
    frames: int
    expected: float

    @property
    def measured(self) -> float:
        """False frames a million bytes."""
        return self.frames / self.bytes * 1e6

    @property
    def at_most(self) -> float:
        """Where none was found: the rate that 95 % of such measurements stay below (rule of three)."""
        return self.measured if self.frames else 3 / self.bytes * 1e6

    def as_dict(self) -> dict[str, Any]:
        return {
            "random_bytes": self.bytes,
            "false_frames": self.frames,
            "per_million_bytes": self.measured,
            "per_million_bytes_at_most": self.at_most,
            "per_million_bytes_expected": self.expected,
        }


def measure_noise(codec: Codec, sender: End, size: int, seed: int) -> Noise:
    """Decode ``size`` random bytes as if this end had sent them."""
    generator = np.random.default_rng(seed)
    frames = done = 0
    while done < size:
        data = generator.integers(0, 256, min(_CHUNK, size - done), dtype=np.uint8)
        frames += codec.decode_columns(data.tobytes(), sender).stats.frames
        done += len(data)
    return Noise(sender, done, frames, 1e6 * expected_rate(codec.model, sender))


def expected_rate(protocol: Protocol, sender: End) -> float:
    """False frames for each random byte, worked out: the chance that constants, id, size and checks all fit."""
    frame = protocol.frame
    messages = [message for message in protocol.messages if message.sent_by(sender)]
    constants = sum(len(part.value) for part in frame.parts)
    by_chance = 2.0 ** -(8 * constants + check_bits(frame))
    if frame.delimiter is not None:
        return by_chance * _delimited(frame, messages)
    return by_chance * _id_and_size_fit(frame, messages)


def _id_and_size_fit(frame: Frame, messages: list[Message]) -> float:
    id_part, length = frame.part(PartKind.ID), frame.part(PartKind.LENGTH)
    id_bits = 0 if id_part is None else 8 * id_part.size
    sizes = 1 if length is None else 2 ** (8 * length.size)
    payload = frame.part(PartKind.PAYLOAD)
    by_length = payload is not None and payload.payload == PayloadRule.BY_LENGTH
    if frame.deliver_unknown:
        return min(1.0, (frame.max_payload + 1) / sizes) if by_length else 1.0
    fitting = (m.max_payload - m.min_payload + 1 if by_length else 1 for m in messages)
    return min(1.0, sum(fitting) / sizes * 2.0**-id_bits)


def _delimited(frame: Frame, messages: list[Message]) -> float:
    """For each random byte: it is a zero, and the nonzero bytes before it are a possible result of COBS."""
    id_part = frame.part(PartKind.ID)
    id_bits = 0 if id_part is None else 8 * id_part.size
    longest = min(_LONGEST_SEGMENT, fixed_bytes(frame) + frame.max_payload + 1)
    valid = [1.0]  # by length: the chance that this many nonzero bytes are a chain of COBS blocks
    total = 0.0
    for length in range(1, longest + 1):
        valid.append(sum(valid[max(0, length - 255) :]) / 255)
        payload = length - 1 - fixed_bytes(frame)
        if payload < 0:
            continue
        if frame.deliver_unknown:
            fits = 1.0
        else:
            fits = sum(m.min_payload <= payload <= m.max_payload for m in messages) * 2.0**-id_bits
        total += (255 / 256) ** length * valid[length] * fits
    return total / 256 / 256  # a zero before it and one behind


def judge(protocol: Protocol, noise: list[Noise], places: Places) -> list[Finding]:
    """A finding for the worse direction, where random bytes yield frames often."""
    worst = max(noise, key=lambda each: max(each.measured, each.expected))
    figure = worst.measured if worst.frames else worst.expected
    if figure <= _TOO_MANY:
        return []
    place = places.at("frame")
    byte_rate = protocol.link.baud / protocol.link.bits_per_byte
    return [
        Finding(
            RULE,
            Severity.WARNING,
            f"random bytes yield {figure:.3g} false frames a million ({direction(worst.sender)}): one every "
            f"{count(1e6 / figure)} bytes",
            f"an open input or a wrong baud rate brings such bytes, up to {count(byte_rate)} a second on this line",
            "take a check of 16 bits or more, a longer magic, or a tail",
            place.line,
            place.column,
        )
    ]
