"""How the commands show messages, statistics and errors."""

from __future__ import annotations

import os
import sys
from typing import Any

from rich.console import Console
from rich.markup import escape

from wirebond.cli.values import hex_of, to_json
from wirebond.codec import Codec, Message, Stats

console = Console(highlight=False)
errors = Console(stderr=True, highlight=False, soft_wrap=True)


def fail(text: str) -> None:
    """One error, in sentences, on stderr."""
    errors.print(f"[bold red]wirebond:[/] {escape(text)}")


def message_dict(message: Message, codec: Codec) -> dict[str, Any]:
    """What a JSON line says of a message."""
    out: dict[str, Any] = {
        "t": round(message.t, 6),
        "offset": message.offset,
        "message": message.name,
        "sender": message.sender,
        "id": message.id,
        "fields": message.fields,
        "raw": hex_of(message.raw),
    }
    line = codec.log_line(message)
    if line is not None:
        out["log"] = {"level": line.level, "text": line.text}
    violations = message.violations
    if violations:
        out["violations"] = violations
    return out


def print_message(message: Message, codec: Codec) -> None:
    """One JSON line, at once: a reader may wait for it."""
    try:
        sys.stdout.write(to_json(message_dict(message, codec)) + "\n")
        sys.stdout.flush()
    except BrokenPipeError:  # the reader has seen enough, as `head` has: that is no error
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(0) from None


def stats_line(stats: Stats) -> str:
    """The whole account in one sentence."""
    parts = [f"{stats.bytes} bytes: {stats.frames} frames ({stats.frame_bytes} bytes)"]
    if stats.unknown_frames:
        parts.append(f"{stats.unknown_frames} of them unknown")
    if stats.fill_bytes:
        parts.append(f"{stats.fill_bytes} fill")
    if stats.pending_bytes:
        parts.append(f"{stats.pending_bytes} pending")
    parts += [f"{count} discarded as {cause}" for cause, count in stats.discarded_bytes.items() if count]
    return ", ".join(parts)


def values_text(fields: dict[str, Any]) -> str:
    """Field values for a person: short numbers, units left to the column's reader."""
    return "  ".join(f"{name} {_value_text(value)}" for name, value in fields.items())


def _value_text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return "[" + " ".join(_value_text(entry) for entry in value) + "]"
    if isinstance(value, dict):
        return "{" + values_text(value) + "}"
    if isinstance(value, bytes):
        return hex_of(value)
    return str(value)
