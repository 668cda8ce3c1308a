"""Computes how long intact frames wait after a false start: bytes that look like a header, so that the receiver waits
for more."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

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
from wirebond.protocol.model import ByteOrder, End, Protocol, Subject
from wirebond.protocol.plan import Form

RULE = "hold-back"
_LONG = 0.020  # seconds; a control loop at 50 Hz misses a whole turn
_FAR_MORE = 4  # times the bound of this file's own receiver


@dataclass(frozen=True)
class HoldBack:
    """A direction, in bytes that must come after the false header before a good frame there is delivered.

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
    """Feed the worst false header of each form, and good frames after it, byte by byte.

    None if this end sends nothing.
    """
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
    headers = {max(own.frames, key=len)[: form.prefix]}
    headers.update(_of_known_messages(model, sender))
    if newer := _false_headers(model, sender, model.format.max_payload_from(sender)):  # that a newer peer might send
        headers.update(newer[1])
    bound = max(_bytes_until_delivery(codec, sender, header, good) for header in headers)
    unbounded = None
    if longest := _false_headers(model, sender, 0xFFFF):
        open_codec, headers = longest
        unbounded = max(_bytes_until_delivery(open_codec, sender, header, good) for header in headers)
    return HoldBack(sender, bound, unbounded, checked, byte_seconds)


def _false_headers(model: Protocol, sender: End, most: int) -> tuple[Codec, set[bytes]] | None:
    """Return a receiver that takes any id and size, and for each form the bytes before the largest payload up to
    ``most`` that its length can express; None if there is no such receiver."""
    usual, *others = forms(model, sender)
    possible = payload_sizes(usual, most)
    longest = max([*(possible or ()), *(max(_sizes(form, most), default=0) for form in others)], default=0)
    open_model = open_protocol(model, sender, longest) if possible else None
    if not possible or open_model is None:
        return None
    codec = Codec(open_model)
    # Not all zeros: some formats do not send those at the payload's end.
    content = {ANY_CONTENT: b"\xff" * max(possible)} if max(possible) else {}
    headers = {codec.encode(ANY, content)[: usual.prefix]}
    headers.update(_header(form, max(sizes), 1) for form in others if (sizes := _sizes(form, most)))
    return codec, headers


def _of_known_messages(model: Protocol, sender: End) -> set[bytes]:
    """Return, for each form but the usual one, the header of the largest message that it can announce."""
    found = set()
    for form in forms(model, sender)[1:]:
        largest = [
            (max(sizes), message.id)
            for message in model.messages
            if message.sent_by(sender)
            if (sizes := [n for n in _sizes(form, message.max_payload) if n >= message.min_payload])
        ]
        if largest:
            found.add(_header(form, *max(largest)))
    return found


def _sizes(form: Form, most: int) -> list[int]:
    """Return the payload sizes up to ``most`` that this form can announce, where no check of the header speaks for
    them."""
    if form.header_checks or form.length is None:
        return []
    choices = [held.choice for held in form.choices if held.choice.subject == Subject.SIZE]
    return [n for n in payload_sizes(form, most) or () if all(choice.holds(n) for choice in choices)]


def _header(form: Form, payload: int, message_id: int) -> bytes:
    """Return the bytes before a payload of this size, with the defaults of all other fields."""
    header = bytearray(form.prefix)
    numbers = [(field.number, field.default) for field in form.header]
    if form.length is not None:
        numbers.append((form.length, (payload - form.length_bias) // form.length_unit))
    if form.id is not None:
        numbers.append((form.id, message_id))
    for number, value in numbers:
        if number.at.from_end:
            continue
        place = slice(number.at.offset, number.at.offset + number.bytes)
        order: Literal["little", "big"] = "little" if number.order == ByteOrder.LITTLE else "big"
        before = int.from_bytes(header[place], order)
        header[place] = (before | (value & number.mask) << number.shift).to_bytes(number.bytes, order)
    for constant in form.constants[: form.prefix_constants]:
        at = constant.at.offset
        header[at] = header[at] & ~constant.mask & 0xFF | constant.value
    return bytes(header)


def _bytes_until_delivery(codec: Codec, sender: End, false_header: bytes, good: bytes) -> int:
    """Return how many bytes after its own the first good frame is delivered; 0: with its last byte."""
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
    for each in sorted(found, key=lambda each: -each.seconds):
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
