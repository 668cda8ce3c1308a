"""The last bytes of a link as text or JSON: `wirebond dump` and `monitor --dump-on-exit`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from wirebond.cli.output import errors, plain, write
from wirebond.cli.rounds import time_left
from wirebond.cli.shown import message_dict, title_of, values_text
from wirebond.cli.signals import ended_by_signals
from wirebond.cli.values import hex_of, to_json
from wirebond.link import Dump, DumpEntry, Link, open_link
from wirebond.visible import visible
from wirebond.whole_file import write_whole

_SIGNS = {"received": "<", "sent": ">", "port": "-"}
_REFRESH = 0.1  # seconds


def dump_port(path: Path, port: str, baud: int | None, seconds: float | None, as_json: bool) -> int:
    """Listen, and print everything that is kept at the end. Exit code 1 if no byte came or left."""
    with open_link(path, port, baud, hold_back=False, listen="all") as link:
        errors.print(f"listening on {plain(link.port)}" + (" until Ctrl-C" if seconds is None else ""), style="dim")
        with ended_by_signals():
            try:
                for left in time_left(seconds):
                    link.receive(min(_REFRESH, left))
            except KeyboardInterrupt:
                pass
        dump = link.dump()
    write(dump_json(dump) if as_json else dump_text(dump))
    return 0 if dump.received or dump.sent else 1


def save(link: Link, path: Path) -> None:
    """Write the dump to a file; one JSON object a line if its name ends in ``.jsonl``."""
    dump = link.dump()
    write_whole(path, dump_json(dump) if path.suffix == ".jsonl" else dump_text(dump))
    errors.print(f"{plain(str(path))}: the last {len(dump.received)} bytes received and {len(dump.sent)} sent")


def dump_text(dump: Dump) -> str:
    """Return a line for each entry: seconds before the end, direction, kind, bytes, meaning."""
    lines = [f"# {dump.codec.name}: seconds before the end; < received, > sent, - the port"]
    if dump.dropped_bytes:
        lines.append(f"# {dump.dropped_bytes} older bytes are not kept")
    lines += [f"{e.t - dump.t:12.6f} {_SIGNS[e.direction]} {e.kind:<9} {_said(e)}".rstrip() for e in dump.entries]
    return "".join(visible(line) + "\n" for line in lines)


def dump_json(dump: Dump) -> str:
    """Return a JSON object a line."""
    return "".join(to_json(entry_dict(entry, dump)) + "\n" for entry in dump.entries)


def entry_dict(entry: DumpEntry, dump: Dump) -> dict[str, Any]:
    out: dict[str, Any] = {
        "t": round(entry.t, 6),
        "ago": round(dump.t - entry.t, 6),
        "direction": entry.direction,
        "kind": entry.kind,
    }
    if entry.message is not None:
        told = message_dict(entry.message, dump.codec)
        out |= {key: value for key, value in told.items() if key not in ("t", "offset")}
    elif entry.bytes:
        out["raw"] = hex_of(entry.bytes)
    if entry.causes:
        out["causes"] = entry.causes
    return out


def _said(entry: DumpEntry) -> str:
    meaning = ", ".join(f"{count} {cause}" for cause, count in entry.causes.items())
    if entry.message is not None:
        meaning = f"{title_of(entry.message)}  {values_text(entry.message.fields)}".strip()
    return f"{hex_of(entry.bytes)}  {meaning}" if meaning else hex_of(entry.bytes)
