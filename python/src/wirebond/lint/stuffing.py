"""Whether a stuffed frame is accepted after a zero byte slipped in at one of its ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from wirebond.codec import Codec
from wirebond.lint.damage import Measured
from wirebond.lint.findings import Finding, Severity
from wirebond.lint.frame_facts import ENDS, open_protocol
from wirebond.lint.places import Places
from wirebond.lint.samples import pool
from wirebond.lint.wording import count, percent
from wirebond.protocol.model import PartKind, Protocol

RULE = "inserted-zero"
_EMPTY_BLOCK = b"\x01"  # COBS for one zero
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
    """One more zero before or behind the content of each frame. None for frames without stuffing.

    On the wire that is one byte 0x01 at either end; a delimiter whose lowest bit flips has the same effect.
    """
    if codec.model.frame.stuffing == "none":
        return None
    own, any_size = Measured(0, 0), Measured(0, 0)
    for end in ENDS:
        frames = pool(codec, end, seed, _FRAMES)
        model = open_protocol(codec.model, end, codec.model.frame.max_payload + 1)
        if frames is None or model is None:
            continue
        open_codec = Codec(model)
        for frame in frames.frames:
            for damaged in (frame[:1] + _EMPTY_BLOCK + frame[1:], frame[:-1] + _EMPTY_BLOCK + frame[-1:]):
                own += Measured(1, codec.decode_columns(damaged, end).stats.frames)
                any_size += Measured(1, open_codec.decode_columns(damaged, end).stats.frames)
    return InsertedZero(own, any_size)


def judge(protocol: Protocol, found: InsertedZero | None, places: Places) -> list[Finding]:
    if found is None or not found.any_size.accepted:
        return []
    check = protocol.frame.part(PartKind.CHECK)
    name = "no check" if check is None or check.algorithm is None else check.algorithm.name
    place = places.part("check")
    return [
        Finding(
            RULE,
            Severity.WARNING,
            f"{name} lets {percent(found.any_size.share)} of frames pass after a zero byte was inserted before or "
            f"behind the content ({count(found.any_size.accepted)} of {count(found.any_size.samples)}); by the sizes of "
            f"this file's messages {percent(found.own.share)} are accepted",
            "without a final xor a CRC's register is zero behind an intact frame and stays so with one zero more, and "
            "under COBS a single wrong bit in a delimiter makes that zero",
            "take a CRC with a final xor, such as `crc-16/ibm-sdlc`",
            place.line,
            place.column,
        )
    ]
