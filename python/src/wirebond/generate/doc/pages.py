"""The document as a whole: its title, and its chapters in order."""

from __future__ import annotations

from wirebond.codec import Codec
from wirebond.generate.doc import behaviour, frame, header, messages


def markdown(codec: Codec) -> str:
    """Return the whole document, ending with a line break. The same protocol gives the same text, whatever day it
    is."""
    model = codec.model
    lines = [f"# {model.name}", ""]
    if model.description:
        lines += [model.description, ""]
    lines += [
        "Bytes are written in hexadecimal, in the order in which they are sent. Offsets count from 0. Types: `u` is",
        "unsigned, `i` signed (two's complement), `s` signed (the top bit is the sign, the others the amount),",
        "`bcd` decimal digits of four bits each, `f` IEEE 754; the number is the width in bits. Numbers of several",
        "bytes are little-endian, with `be` big-endian.",
        "*value* says how the number on the wire becomes the value in its unit.",
        "",
        f"Protocol hash: `{codec.hash:016x}`. It changes when frames, fields, scales or names do, and not with units",
        "or ranges.",
        "",
        *behaviour.line_chapter(model),
        *frame.frame_chapter(model),
        *header.header_chapter(model),
        *frame.checks_chapter(model),
        *messages.list_chapter(model),
        *messages.message_chapters(codec),
        *behaviour.schedule_chapter(model),
        *behaviour.deadlines_chapter(model),
        *behaviour.services_chapter(model),
    ]
    return "\n".join(lines).rstrip("\n") + "\n"
