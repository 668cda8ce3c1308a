"""How long good frames wait behind a false start: bytes that look like a header and make the receiver wait for more."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from wirebond.analysis.check.findings import Finding, Severity
from wirebond.analysis.check.frame_facts import (
    ANY,
    ANY_CONTENT,
    forms,
    has_header_check,
    open_protocol,
    payload_sizes,
    senders,
)
from wirebond.analysis.check.places import Places
from wirebond.analysis.check.wording import count, direction, seconds
from wirebond.analysis.samples import pool
from wirebond.codec import Codec
from wirebond.protocol.model import End, Protocol

RULE = "hold-back"
_LONG = 0.020  # seconds; a control loop at 50 Hz misses a whole turn
_FAR_MORE = 4  # times the bound of this file's own receiver


@dataclass(frozen=True)
class HoldBack:
    """One direction, in bytes that must come behind the false header before a good frame there is delivered.

    ``unbounded_bytes`` is the same for a receiver that believes any length; None where the frame has no length.
    ``checked`` : the header has a check of its own, so that only one that passes it by chance holds anything back.
    """

    sender: End
    bytes: int
    unbounded_bytes: int | None
    checked: bool
    byte_seconds: float

    @property
    def seconds(self) -> float:
        return self.bytes * self.byte_seconds

    @property
    def unbounded_seconds(self) -> float | None:
        return None if self.unbounded_bytes is None else self.unbounded_bytes * self.byte_seconds

    def as_dict(self) -> dict[str, Any]:
        return {
            "bytes": self.bytes,
            "seconds": self.seconds,
            "header_check": self.checked,
            "unbounded_bytes": self.unbounded_bytes,
            "unbounded_seconds": self.unbounded_seconds,
        }


def measure_hold_back(codec: Codec, sender: End, seed: int) -> HoldBack | None:
    """Feed the worst false header and good frames behind it, byte by byte. None if this end sends nothing."""
    model = codec.model
    own = pool(codec, sender, seed)
    if own is None:
        return None
    byte_seconds = model.link.bits_per_byte / model.link.baud
    form = forms(model, sender)[0]
    checked = has_header_check(form)
    if model.format.delimiter is not None or model.format.ends_by_silence:
        return HoldBack(sender, 0, None, checked, byte_seconds)  # a delimiter or a pause ends any false start
    good = min(own.frames, key=len)
    bound = _bytes_until_delivery(codec, sender, max(own.frames, key=len)[: form.prefix], good)
    if newer := _false_header(
        model, sender, model.format.max_payload_from(sender)
    ):  # of a message that a newer peer might send
        bound = max(bound, _bytes_until_delivery(codec, sender, newer[1], good))
    unbounded = None
    if longest := _false_header(model, sender, 0xFFFF):
        open_codec, header = longest
        unbounded = _bytes_until_delivery(open_codec, sender, header, good)
    return HoldBack(sender, bound, unbounded, checked, byte_seconds)


def _false_header(model: Protocol, sender: End, most: int) -> tuple[Codec, bytes] | None:
    """A receiver that takes any id and size, and the bytes before the largest payload up to ``most`` that the length
    can tell; None where there is no such receiver."""
    form = forms(model, sender)[0]
    possible = payload_sizes(form, most)
    open_model = open_protocol(model, sender, max(possible)) if possible else None
    if not possible or open_model is None:
        return None
    codec = Codec(open_model)
    # Not all zeros: some formats do not send those at the payload's end.
    content = {ANY_CONTENT: b"\xff" * max(possible)} if max(possible) else {}
    return codec, codec.encode(ANY, content)[: form.prefix]


def _bytes_until_delivery(codec: Codec, sender: End, false_header: bytes, good: bytes) -> int:
    """0 where the first good frame comes out with its own last byte."""
    decoder = codec.decoder(sender)
    decoder.feed(false_header)
    most = max(form.prefix + form.suffix for form in forms(codec.model, sender)) + codec.model.format.max_payload_from(
        sender
    )
    most += codec.model.format.overhead(most)
    stream = good * (2 + most // len(good))
    for fed in range(1, len(stream) + 1):
        if decoder.feed(stream[fed - 1 : fed]):
            return fed if fed > len(good) else 0
    raise AssertionError("a false start is given up after one longest frame")


def assess(protocol: Protocol, found: list[HoldBack], places: Places) -> list[Finding]:
    place = places.part("length")
    for each in found:
        unbounded = each.unbounded_seconds
        if each.checked:
            continue
        if each.seconds > _LONG:
            return [
                Finding(
                    RULE,
                    Severity.WARNING,
                    f"a false start holds good frames back for up to {count(each.bytes)} bytes, "
                    f"{seconds(each.seconds)} at this baud rate ({direction(each.sender)})",
                    "bytes that look like a header make the receiver wait for the rest of a frame that never was",
                    "give the header a check of its own, put frames between delimiters, or lower `max_payload`",
                    place.line,
                    place.column,
                )
            ]
        if unbounded is not None and unbounded > _LONG and unbounded > _FAR_MORE * each.seconds:
            most = protocol.format.max_payload_from(each.sender)
            here = f"{count(each.bytes)} bytes ({seconds(each.seconds)})" if each.bytes else "nothing"
            return [
                Finding(
                    RULE,
                    Severity.NOTE,
                    f"a false start holds back {here} here, by `max_payload` {most}; without "
                    f"max_payload it would be {count(each.unbounded_bytes or 0)} bytes, {seconds(unbounded)}",
                    "the length is believed before any check is seen, so a peer whose parser takes every length waits "
                    "that long",
                    "bound the length in the peer's parser, too, or give the header a check of its own",
                    place.line,
                    place.column,
                )
            ]
    return []


def directions(codec: Codec, seed: int) -> list[HoldBack]:
    return [found for end in senders(codec.model) if (found := measure_hold_back(codec, end, seed)) is not None]
