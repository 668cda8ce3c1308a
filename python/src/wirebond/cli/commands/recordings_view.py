"""Shows a recording for ``wirebond info``: as lines for a person, and as values for JSON."""

from __future__ import annotations

from collections import Counter
from typing import Any

from wirebond.cli.shown import stats_line
from wirebond.codec import Stats
from wirebond.recording.recording import Recording

_MOST_EVENTS = 20  # that are shown to a person


def facts(recording: Recording, accounts: dict[str, Stats], repaired: bool) -> dict[str, Any]:
    """Collect the facts of a recording. ``accounts``: by the end that sent the bytes."""
    return {
        "file": str(recording.path),
        "protocol": recording.codec.name,
        "hash": recording.protocol_hash or f"{recording.codec.hash:016x}",
        "role": recording.role,
        "port": recording.port,
        "started": recording.started.isoformat(timespec="milliseconds"),
        "seconds": round(recording.duration, 6),
        "size": recording.size,
        "capture": recording.is_capture,
        "finished": recording.is_finished,
        "repaired": repaired or bool(recording.repaired),
        "problems": list(recording.problems) or ([recording.repaired] if recording.repaired else []),
        "notes": [{"written": n.written.isoformat(timespec="seconds"), "text": n.text} for n in recording.notes],
        "bytes": recording.byte_counts,
        "lost_bytes": lost_bytes(recording),
        "accounts": {sender: stats.as_dict() for sender, stats in accounts.items()},
        "events": [{"t": round(e.t, 6), "kind": e.kind, **e.facts} for e in recording.events],
    }


def lost_bytes(recording: Recording) -> int:
    """Return how many bytes of the line the recorder missed because it came too late."""
    lost = [event.facts for event in recording.events if event.kind == "lost"]
    counts = [facts.get(name, 0) for facts in lost for name in ("received_bytes", "sent_bytes")]
    return sum(count for count in counts if isinstance(count, int))


def lines(recording: Recording, accounts: dict[str, Stats], repaired: bool) -> list[str]:
    """Write the facts for a person."""
    out = [
        f"{recording.path}: {recording.duration:.3f} s of {recording.codec.name} "
        f"(hash {recording.protocol_hash or 'not known'}) as the {recording.role}"
        + (f" on {recording.port}" if recording.port else ""),
        f"began {recording.started:%Y-%m-%d %H:%M:%S} UTC; {recording.size} bytes"
        + ("" if recording.is_finished or repaired else "; not finished")
        + ("; repaired" if repaired else ""),
    ]
    if recording.is_capture:
        out.append(f"a raw capture without times: these are of a full line of {recording.codec.model.link.baud} baud")
    if recording.protocol_hash not in ("", f"{recording.codec.hash:016x}"):
        out.append(f"decoded with another protocol: its hash is {recording.codec.hash:016x}")
    if recording.repaired:
        out.append(f"repaired before: {recording.repaired}")
    out += [f"note of {note.written:%Y-%m-%d %H:%M} UTC: {note.text}" for note in recording.notes]
    for sender, stats in accounts.items():
        out.append(f"{sender}: {stats_line(stats)}")
        for name, count in stats.messages.items():
            rate = f", {count / recording.duration:.1f}/s" if recording.duration else ""
            out.append(f"  {name}: {count}{rate}")
    if lost := lost_bytes(recording):
        out.append(f"not recorded, because the recorder came too late: {lost} bytes")
    kinds = Counter(event.kind for event in recording.events)
    out.append("events: " + (", ".join(f"{kind} {count}" for kind, count in kinds.items()) or "none"))
    for event in recording.events[:_MOST_EVENTS]:
        values = " ".join(f"{name}={value}" for name, value in event.facts.items())
        out.append(f"  {event.t:.3f} s {event.kind} {values}".rstrip())
    if len(recording.events) > _MOST_EVENTS:
        out.append(f"  and {len(recording.events) - _MOST_EVENTS} more; --json has them all")
    return out
