"""The file's worked examples, worked out again: encoded and decoded, and compared byte by byte and value by value."""

from __future__ import annotations

import math
from typing import Any

from wirebond.analysis.check.findings import Finding, Severity
from wirebond.analysis.check.frame_facts import forms
from wirebond.analysis.check.places import Places
from wirebond.analysis.check.wording import plural
from wirebond.codec import Codec, Message
from wirebond.errors import MessageError
from wirebond.protocol.model import Example, Part, PartKind, Protocol, Stuffing
from wirebond.protocol.model.forms import header_fields, parts_of_forms
from wirebond.protocol.problems import Place

RULE = "example"
_MOST_BYTES = 4  # differing bytes that a sentence lists


def assess(codec: Codec, places: Places) -> list[Finding]:
    found = []
    for index, example in enumerate(codec.model.examples):
        wrong = _compare(codec, example, example.fields)
        if wrong is not None:
            found.append(_finding(example, wrong, places.at("examples", index, "bytes")))
    return found


def _finding(example: Example, wrong: tuple[str, str, str], place: Place) -> Finding:
    sentence, reason, remedy = wrong
    return Finding(
        RULE,
        Severity.ERROR,
        f"the example of `{example.message}`: {sentence}",
        reason,
        remedy,
        place.line,
        place.column,
    )


def _compare(codec: Codec, example: Example, values: dict[str, Any]) -> tuple[str, str, str] | None:
    """Return sentence, reason and remedy; None if the example is right."""
    try:
        expected = codec.encode(example.message, values, header=dict(example.header), sender=example.sender)
    except MessageError as error:
        return (
            f"its values cannot be encoded: {error}",
            "a worked example has to be one that works",
            "correct its values",
        )
    if example.frame != expected:
        return _bytes_differ(codec, example, expected)
    decoder = codec.decoder(example.sender)
    decoder.expect(codec.tables.request_for(example.message))
    messages = decoder.feed(example.frame) + decoder.finish()
    if [message.name for message in messages] != [example.message]:
        return (
            f"its bytes decode as {', '.join(message.name for message in messages) or 'nothing'}",
            "the receiver does not read the sender's values",
            "this is a fault of Wirebond; please report it with the file",
        )
    different = _different_values(messages[0], values)
    if different is None:
        return None
    name, wanted, got = different
    return (
        f"`{name}` comes back as {got}, and the example says {wanted}",
        "the wire carries no number that is exactly this value",
        "write the value that the wire carries, or take a finer `scale`",
    )


def _bytes_differ(codec: Codec, example: Example, expected: bytes) -> tuple[str, str, str]:
    given = example.frame
    hex_expected = expected.hex(" ").upper()
    if len(given) != len(expected):
        return (
            f"it has {plural(len(given), 'byte')}, expected {len(expected)}",
            f"these values make {hex_expected}",
            "compare part by part: a byte is missing, or one too many",
        )
    wrong = [i for i, (a, b) in enumerate(zip(given, expected, strict=True)) if a != b]
    listed = ", ".join(
        f"byte {i}{_part_at(codec.model, example, i)} is 0x{given[i]:02X}, expected 0x{expected[i]:02X}"
        for i in wrong[:_MOST_BYTES]
    )
    more = f", and {len(wrong) - _MOST_BYTES} more" if len(wrong) > _MOST_BYTES else ""
    return (
        listed + more,
        f"these values make {hex_expected}; {_as_received(codec, example)}",
        "if the rule is right, correct the example's bytes; if the bytes are proven, the frame format or the fields",
    )


def _as_received(codec: Codec, example: Example) -> str:
    """Return the receiver's reading of the example's own bytes."""
    decoder = codec.decoder(example.sender)
    decoder.expect(codec.tables.request_for(example.message))
    messages = decoder.feed(example.frame) + decoder.finish()
    if messages:
        values = ", ".join(f"{name} {value}" for name, value in messages[0].fields.items())
        return f"the example's bytes are read as {messages[0].name} {values}".rstrip()
    causes = [cause for cause, number in decoder.stats.rejected_candidates.items() if number]
    return f"the receiver refuses the example's bytes ({', '.join(causes) or 'no_start'})"


def _part_at(protocol: Protocol, example: Example, index: int) -> str:
    """Return the part of the frame that this byte belongs to, as ` (check)`; empty for stuffed frames, whose bytes
    move."""
    frame_format = protocol.format
    if frame_format.stuffing != Stuffing.NONE or frame_format.delimiter is not None:
        return ""
    parts = _parts(protocol, example)
    payload = len(example.frame) - sum(part.size for part in parts)
    at = 0
    for part in parts:
        at += payload if part.kind == PartKind.PAYLOAD else part.size
        if index < at:
            return f" ({part.kind})" if part.name in ("", part.kind) else f" ({part.kind} {part.name})"
    return ""


def _parts(protocol: Protocol, example: Example) -> tuple[Part, ...]:
    """Return the parts that exist with the example's header values."""
    fields = {field.name: field for field in header_fields(protocol.format.parts)}
    given = {name: fields[name].value.wire_bits(value) for name, value in example.header}
    both = zip(parts_of_forms(protocol.format.parts, example.sender), forms(protocol, example.sender), strict=True)
    for form_parts, form in both:
        agrees = all(given.get(f.name, f.default) & f.fixed_mask == f.fixed_value for f in form.header)
        if agrees and given.keys() <= {field.name for field in form.header}:
            return form_parts.parts
    raise AssertionError("the example was encoded, so that it has a form")


def _different_values(message: Message, wanted: dict[str, Any]) -> tuple[str, Any, Any] | None:
    for name, value in wanted.items():
        got = message.fields[name]
        if not _same(value, got):
            return name, value, got
    return None


def _same(wanted: Any, got: Any) -> bool:
    if isinstance(wanted, dict) and isinstance(got, dict):
        return all(_same(value, got[name]) for name, value in wanted.items())
    if isinstance(wanted, list) and isinstance(got, list):
        if any(isinstance(item, str) for item in wanted + got):
            return sorted(map(str, wanted)) == sorted(map(str, got))  # flags, in any order
        return len(wanted) == len(got) and all(_same(a, b) for a, b in zip(wanted, got, strict=True))
    if isinstance(wanted, (str, bytes, bool)) or isinstance(got, (str, list)):
        # A number for an enum or flags: the bytes were the same, so the names are its own.
        return wanted == got or not isinstance(wanted, type(got))
    return math.isclose(float(wanted), float(got), rel_tol=1e-6, abs_tol=1e-9)
