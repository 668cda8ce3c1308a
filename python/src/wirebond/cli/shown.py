"""Shows messages, rates and accounts, in one line or as JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from rich.text import Text

from wirebond.cli.output import write
from wirebond.cli.values import hex_of, to_json
from wirebond.codec import Codec, Message, SequenceStats, Stats
from wirebond.protocol.decimals import decimal_text
from wirebond.protocol.log import LogLine
from wirebond.protocol.model import Field
from wirebond.visible import visible

if TYPE_CHECKING:  # most commands open no link
    from wirebond.link.rates import MessageRate, Rates

_BEHIND = 0.1  # of the due messages
_MOST_KINDS = 8  # of messages and of unlisted frames that a line names
_LEVEL_STYLES = {"debug": "dim", "info": "cyan", "warning": "yellow", "error": "bold red"}


def log_text(line: LogLine) -> Text:
    """Return a log line whose level has its colour."""
    shown, level = str(line), visible(line.level)
    return Text.assemble((level, _LEVEL_STYLES.get(line.level, "")), shown[len(level) :])


def message_dict(message: Message, codec: Codec) -> dict[str, Any]:
    """Return the JSON form of a message."""
    out: dict[str, Any] = {
        "t": round(message.t, 6),
        "offset": message.offset,
        "message": message.name,
        "sender": message.sender,
        "id": message.id,
        "fields": message.fields,
        "raw": hex_of(message.raw),
    }
    stamp = message.stamp
    if stamp is not None:
        out["stamp"] = round(stamp, 6)
        out["stamp_error"] = round(message.stamp_error or 0.0, 6)
    header = message.header
    if header:
        out["header"] = header
    line = codec.log_line(message)
    if line is not None:
        out["log"] = {"level": line.level, "text": line.text}
    counters = codec.counters(message)
    if counters is not None:
        out["counters"] = counters.as_dict()
    peer = peer_dict(message, codec)
    if peer is not None:
        out["peer"] = peer
    violations = message.violations
    if violations:
        out["violations"] = violations
    return out


def peer_dict(message: Message, codec: Codec) -> dict[str, str] | None:
    """Return the state of the sender's protocol file by its hello, or None if the message is none."""
    service = codec.model.service("hello")
    if service is None or message.name != service.message("message"):
        return None
    theirs = message.fields["protocol_hash"]
    return {"state": "same" if theirs == codec.hash else "different", "hash": f"{theirs:016x}"}


def print_message(message: Message, codec: Codec) -> None:
    """Print one JSON line."""
    write(to_json(message_dict(message, codec)) + "\n")


def stats_line(stats: Stats) -> str:
    """Return the whole account in one sentence."""
    parts = [f"{stats.bytes} bytes: {stats.frames} frames ({stats.frame_bytes} bytes)"]
    if stats.unknown_frames:
        parts.append(f"{stats.unknown_frames} of them unknown")
    if stats.foreign_frames:
        parts.append(f"{stats.foreign_frames} of them foreign")
    if stats.unlisted_frames:
        parts.append(f"{stats.unlisted_frames} not in the file ({unlisted_text(stats)})")
    if stats.fill_bytes:
        parts.append(f"{stats.fill_bytes} fill")
    if stats.pending_bytes:
        parts.append(f"{stats.pending_bytes} pending")
    if stats.sequence is not None:
        parts += sequence_parts(stats.sequence)
    parts += [f"{count} discarded as {cause}" for cause, count in stats.discarded_bytes.items() if count]
    return ", ".join(parts)


def rates_line(rates: Rates) -> str:
    """Describe the recent rates of the link in one sentence."""
    receive, send = rates.receive, rates.send
    came = [_rate_text(name, rate) for name, rate in rates.messages.items()]
    left = [f"sent {_rate_text(name, rate)}" for name, rate in rates.sent.items() if rate.per_second > 0]
    parts = [
        f"last {rates.seconds:.1f} s: received {receive.line_use:.1%}, sent {send.line_use:.1%} of the line "
        f"({rates.baud} baud, {rates.bits_per_byte:g} bits a byte)",
        *came[:_MOST_KINDS],
        *(["..."] if len(came) > _MOST_KINDS else []),
        *left[:_MOST_KINDS],
        *(["..."] if len(left) > _MOST_KINDS else []),
    ]
    if send.lost:
        parts.append(f"{send.lost:.2%} of the offered frames lost")
    return ", ".join(parts)


def _rate_text(name: str, rate: MessageRate) -> str:
    return f"{name} {rate.per_second:.1f}/s" + ("" if rate.due is None else f" of {rate.due:.4g}/s")


def behind_schedule(rates: Rates) -> list[str]:
    """List the messages of which more than a tenth did not come."""
    return [
        f"{name} {rate.per_second:.1f}/s of {rate.due:.4g}/s"
        for name, rate in rates.messages.items()
        if rate.due is not None and rate.missing is not None and rate.missing > _BEHIND
    ]


def sequence_parts(sequence: SequenceStats) -> list[str]:
    """Describe the results of the sequence numbers; empty if all is well."""
    parts = []
    if sequence.gaps:
        parts.append(f"{sequence.gaps} missing by their numbers ({sequence.loss:.2%})")
    if sequence.repeats:
        parts.append(f"{sequence.repeats} repeated numbers")
    if sequence.restarts:
        parts.append(f"{sequence.restarts} restarts of the count")
    return parts


def title_of(message: Message) -> str:
    """Return the message's name, followed by the frame's own fields: ``state [servo 3]``."""
    header = values_text(message.header, between=", ")
    return f"{message.name} [{header}]" if header else message.name


def unlisted_text(stats: Stats) -> str:
    """List unlisted ids, the most frequent first: ``id 30, 28 bytes: 7``."""
    kinds = sorted(stats.unlisted.items(), key=lambda kind: -kind[1])
    shown = [f"id {id}, {size} bytes: {count}" for (id, size), count in kinds[:_MOST_KINDS]]
    return "; ".join(shown) + ("; ..." if len(kinds) > _MOST_KINDS else "")


def values_text(fields: Mapping[str, Any], between: str = "  ") -> str:
    """Write field values for a person: short numbers, without units."""
    return between.join(f"{path} {text_of(value)}" for path, value in flat_values(fields))


def text_of(value: str | list[str]) -> str:
    """Write one value of `flat_values`."""
    return value if isinstance(value, str) else f"[{' '.join(value)}]"


def flat_values(fields: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, str | list[str]]]:
    """Yield each value with its path, as text. An array is a list of texts, and so is each field of a group's
    elements."""
    for name, value in fields.items():
        path = f"{above}{name}"
        if isinstance(value, dict):
            yield from flat_values(value, f"{path}.")
        elif not isinstance(value, list):
            yield path, _value_text(value)
        elif value and all(isinstance(one, dict) and one.keys() == value[0].keys() for one in value):
            yield from flat_values({key: [one[key] for one in value] for key in value[0]}, f"{path}.")
        else:
            yield path, [_value_text(one) for one in value]


def units_of(fields: Iterable[Field], above: str = "") -> dict[str, str]:
    """Return the unit of each value of `flat_values` that has one, by its path."""
    found: dict[str, str] = {}
    for field in fields:
        path = f"{above}{field.name}"
        found |= units_of(field.fields, f"{path}.")
        if field.unit:
            found[path] = field.unit
    return found


def _value_text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return decimal_text(value, 4)
    if isinstance(value, list):
        return "[" + " ".join(_value_text(entry) for entry in value) + "]"
    if isinstance(value, dict):
        return "{" + values_text(value) + "}"
    if isinstance(value, bytes):
        return hex_of(value)
    return visible(str(value))
