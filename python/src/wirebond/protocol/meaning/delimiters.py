"""Finds the bytes that a text must not contain: the delimiters of a frame that is not stuffed."""

from __future__ import annotations

from dataclasses import replace

from wirebond.protocol.model import Field, FrameFormat, Message


def with_excluded(messages: tuple[Message, ...], frame_format: FrameFormat) -> tuple[Message, ...]:
    """Return the messages, each text with the delimiters that would end or begin a frame within it.

    Numbers may hold such bytes by chance; ``check`` says how many frames that costs.
    """
    if frame_format.delimiter is None or frame_format.stuffing.hides_delimiters:
        return messages
    marks = tuple(dict.fromkeys(mark for mark in (frame_format.delimiter, frame_format.opening) if mark))
    return tuple(replace(message, fields=_excluding(message.fields, marks)) for message in messages)


def _excluding(fields: tuple[Field, ...], marks: tuple[bytes, ...]) -> tuple[Field, ...]:
    return tuple(
        replace(
            field,
            excludes=marks if field.value_type is str else (),
            fields=_excluding(field.fields, marks),
        )
        for field in fields
    )
