"""Finds stuffed frames that are accepted after a zero byte was inserted at one of their ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from wirebond.analysis.check.damage import Measured
from wirebond.analysis.check.findings import Finding, Severity
from wirebond.analysis.check.frame_facts import open_protocol, senders
from wirebond.analysis.check.places import Places
from wirebond.analysis.check.wording import count, percent
from wirebond.analysis.samples import pool
from wirebond.codec import Codec
from wirebond.protocol.model import CheckKind, FrameFormat, PartKind, Protocol, Stuffing

RULE = "inserted-zero"
_FRAMES = 64  # of each message


@dataclass(frozen=True)
class InsertedZero:
    """``own``: by the protocol's receiver. ``any_size``: by one that does not know the messages' sizes."""

    own: Measured
    any_size: Measured

    def as_dict(self) -> dict[str, Any]:
        return {
            name: {"samples": measured.samples, "accepted": measured.accepted}
            for name, measured in (("own", self.own), ("any_size", self.any_size))
        }


def measure_inserted_zero(codec: Codec, seed: int) -> InsertedZero | None:
    """Insert one more zero before or after the content of each frame. Returns None for frames without stuffing.

    Under COBS that is one byte 0x01 on the wire; a delimiter whose lowest bit flips has the same effect.
    """
    frame_format = codec.model.format
    if not frame_format.stuffing.hides_delimiters or frame_format.is_sized:  # there the length shows an additional byte
        return None
    zero = _stuffed_zero(frame_format)
    opening = len(frame_format.opening or b"")
    closing = len(frame_format.delimiter or b"")
    own, any_size = Measured(0, 0), Measured(0, 0)
    for end in senders(codec.model):
        frames = pool(codec, end, seed, _FRAMES)
        model = open_protocol(codec.model, end, codec.model.format.max_payload + 1)
        if frames is None or model is None:
            continue
        open_codec = Codec(model)
        for frame in frames.frames:
            for damaged in (frame[:opening] + zero + frame[opening:], frame[:-closing] + zero + frame[-closing:]):
                own += Measured(1, codec.decode_columns(damaged, end).stats.frames)
                any_size += Measured(1, open_codec.decode_columns(damaged, end).stats.frames)
    return InsertedZero(own, any_size)


def _reason(protocol: Protocol) -> str:
    check = protocol.format.part(PartKind.CHECK)
    is_crc = check is not None and check.algorithm is not None and check.algorithm.kind == CheckKind.CRC
    why = (
        "without a final xor a CRC's register is zero after an intact frame, and one more zero does not change it"
        if is_crc
        else "a zero more does not change a sum or an exclusive-or"
    )
    wire = ", and under COBS a single wrong bit in a delimiter makes that zero"
    return why + (wire if protocol.format.stuffing == Stuffing.COBS else "")


def _stuffed_zero(frame_format: FrameFormat) -> bytes:
    if frame_format.stuffing in (Stuffing.HEX, Stuffing.HEX_AFTER_DIGIT):
        return b"00"
    if frame_format.escapes is None:
        return b"\x01"  # COBS: an empty block
    code = dict(frame_format.escapes.pairs).get(0)
    return b"\x00" if code is None else bytes((frame_format.escapes.escape, code))


def explains_damage(protocol: Protocol, found: InsertedZero | None) -> bool:
    """Check whether the inserted zero is why damaged frames pass: a long CRC detects the rest. Then `assess` reports
    it."""
    checks = [part for part in protocol.format.parts if part.kind == PartKind.CHECK]
    long_crc = any(
        p.algorithm is not None and p.algorithm.kind == CheckKind.CRC and p.algorithm.width >= 16 for p in checks
    )
    return long_crc and found is not None and found.any_size.accepted > 0


def assess(protocol: Protocol, found: InsertedZero | None, places: Places) -> list[Finding]:
    if found is None or not found.any_size.accepted:
        return []
    check = protocol.format.part(PartKind.CHECK)
    name = "no check" if check is None or check.algorithm is None else check.algorithm.name
    place = places.part("check")
    return [
        Finding(
            RULE,
            Severity.WARNING,
            f"with {name} {percent(found.any_size.share)} of frames pass after a zero byte was inserted before or "
            f"after the content ({count(found.any_size.accepted)} of {count(found.any_size.samples)}), and "
            f"{percent(found.own.share)} where the sizes of this file's messages are known",
            _reason(protocol),
            "take a CRC with a final xor, such as `crc-16/ibm-sdlc`",
            place.line,
            place.column,
        )
    ]
