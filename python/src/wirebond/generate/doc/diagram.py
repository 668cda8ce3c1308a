"""The frame as a drawing in characters: its parts side by side, and under them what each check covers."""

from __future__ import annotations

from itertools import takewhile

from wirebond.analysis.explain.layout import hex_of
from wirebond.protocol.model import FrameFormat, Part, PartKind, PayloadRule, Stuffing, decimal_digits

_STUFFINGS = {
    Stuffing.COBS: "COBS",
    Stuffing.ESCAPE: "escapes",
    Stuffing.HEX: "hex digits",
    Stuffing.HEX_AFTER_DIGIT: "hex digits",
    Stuffing.INSERTION: "insertion",
}


def diagram(frame_format: FrameFormat, longest_payload: int) -> list[str]:
    parts = [part for part in frame_format.parts if part.in_bits is None]
    columns = [_column(part, longest_payload) for part in parts]
    widths = [max(len(line) for line in column) + 2 for column in columns]
    rule = "+" + "+".join("-" * width for width in widths) + "+"
    lines = [rule]
    for row in range(3):
        lines.append("|" + "|".join(f" {c[row]:<{w - 1}}" for c, w in zip(columns, widths, strict=True)) + "|")
    lines.append(rule)
    starts = [1 + sum(widths[:i]) + i for i in range(len(parts))]
    shown = [parts.index(part) if part.in_bits is None else -1 for part in frame_format.parts]
    for index, place in enumerate(shown):  # a check among shared bits is shown in the column that has them
        shown[index] = shown[index - 1] if place < 0 else place
    for part in frame_format.parts:
        if part.kind == PartKind.CHECK:
            spans = ""
            for first, last in sorted((shown[first], shown[last]) for first, last in part.ranges):
                spans = spans.ljust(starts[first])
                spans += "<" + "-" * (starts[last] + widths[last] - starts[first] - 2) + ">"
            lines.append(f"{spans}  covered by {part.name}")
    around = _around(frame_format)
    return [*lines, "", f"on the wire:  {around}"] if around else lines


def _around(frame_format: FrameFormat) -> str:
    inside = "these parts"
    if frame_format.stuffing.hides_delimiters:
        stuffed = [part.name for part in frame_format.parts if not part.is_plain]
        groups = [
            [p.name for p in takewhile(lambda p: p.is_plain, parts)]
            for parts in (frame_format.parts, frame_format.parts[::-1])
        ]
        front, back = groups[0], groups[1][::-1]
        named = inside if not front and not back else "  ".join(stuffed)
        inside = "  ".join(
            [*front, f"{_STUFFINGS.get(frame_format.stuffing, frame_format.stuffing)}( {named} )", *back]
        )
    if frame_format.ends_by_silence:
        return f"silence  {inside}  silence"
    if frame_format.delimiter is None:
        return inside if frame_format.is_sized else ""
    opening = "" if frame_format.opening is None else f"{hex_of(frame_format.opening)}  "
    return f"{opening}{inside}  {hex_of(frame_format.delimiter)}"


def _column(part: Part, longest_payload: int) -> tuple[str, str, str]:
    """Name, content, size."""
    name = f"{part.name} ?" if part.condition is not None else part.name
    if part.kind == PartKind.PAYLOAD:
        size = str(part.fixed_payload) if part.payload == PayloadRule.FIXED else f"0..{longest_payload}"
        return name, "fields", f"{size} bytes"
    content = hex_of(part.value)
    if part.by_sender or part.alternatives:
        content = " / ".join(hex_of(value) for value in part.alternatives or [v for _, v in part.by_sender])
    if part.kind == PartKind.RESERVED:
        content = hex_of(bytes(min(part.size, 4))) + (" .." if part.size > 4 else "")
    if part.kind == PartKind.CHECK and part.algorithm is not None:
        content = part.algorithm.name
    if part.as_decimal:
        return name, content, f"1..{decimal_digits(part.size)} digits"
    return name, content, f"{part.size} byte{'s' * (part.size != 1)}"
