"""Shows the layout of payloads for ``wirebond check --layout``: a line for each step, or JSON."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from wirebond.cli.output import console, plain, write
from wirebond.codec import Codec
from wirebond.protocol.model.layout import Bits, Characters, Constant, Group, List, Number, Step
from wirebond.protocol.spelling import bytes_text, field_type, repeated_type

_WIDEST_NAME = 32  # columns


def print_layouts(path: Path, codec: Codec) -> None:
    """Print the layout of each message."""
    console.print(plain(f"{path}: protocol {codec.name}, hash {codec.hash:016x}"), soft_wrap=True)
    for message in codec.model.messages:
        size = _range(message.min_payload, message.max_payload)
        sender = "both ends" if message.sender == "both" else f"the {message.sender}"
        lines = list(_lines(message.layout, 0))
        width = min(_WIDEST_NAME, max((len(name) for _, _, name, _ in lines), default=0))
        rows = [f"{at:>7} {taken:>10}  {name:{width}}  {what}".rstrip() for at, taken, name, what in lines]
        heading = f"\n{message.name}: {size} byte{'s' * (size != '1')} from {sender}"
        write("\n".join([heading, f"{'at':>7} {'bytes':>10}", *rows] if rows else [heading]) + "\n")


def layout_json(steps: tuple[Step, ...]) -> list[dict[str, Any]]:
    """Return the steps as JSON has them."""
    found = []
    for step in steps:
        one = step.field
        entry: dict[str, Any] = {"step": type(step).__name__.lower(), "at": step.at, "name": one.name}
        entry |= {"bytes": [one.min_wire_bytes, one.max_wire_bytes], "type": repeated_type(one)}
        match step:
            case Constant():
                entry["constant"] = step.wire.hex(" ")
            case Bits():
                entry["members"] = [
                    {
                        "name": run.field.name,
                        "type": field_type(run.field),
                        "bits": [list(piece) for piece in run.pieces],
                    }
                    for run in step.members
                ]
            case List() | Characters():
                entry["told"] = [{"by": told.name, "per": told.per} for told in step.told]
        if isinstance(step, Group | List) and step.steps:
            entry["steps"] = layout_json(step.steps)
        found.append(entry)
    return found


def _lines(steps: tuple[Step, ...], level: int) -> Iterator[tuple[str, str, str, str]]:
    """Place, size, name and type of each step and of those in it. A place after something that varies is the least
    one, and one in an element counts from the element's start."""
    moved = False
    counts = _counts(steps)
    for step in steps:
        one = step.field
        at = f"{'+' * (level > 0)}{step.at}{'…' * moved}"
        yield at, _range(one.min_wire_bytes, one.max_wire_bytes), "  " * level + one.name, _what(step, counts)
        if isinstance(step, Bits):
            for run in step.members:
                counted = _counted(counts, f"{one.name}.{run.field.name}")
                yield "", "", f"{'  ' * (level + 1)}{run.field.name}", f"{run.text}: {field_type(run.field)}{counted}"
        if isinstance(step, Group | List):
            yield from _lines(step.steps, level + 1)
        moved = moved or one.is_variable


def _counts(steps: tuple[Step, ...]) -> dict[str, str]:
    """Map each counting number to the field that it counts."""
    found: dict[str, list[str]] = defaultdict(list)
    for step in steps:
        for told in step.told if isinstance(step, List | Characters) else ():
            found[told.name].append(step.field.name)
    return {name: " and ".join(counted) for name, counted in found.items()}


def _what(step: Step, counts: dict[str, str]) -> str:
    if isinstance(step, Constant):
        return f"constant {bytes_text(step.wire)}"
    return repeated_type(step.field) + (_counted(counts, step.field.name) if isinstance(step, Number) else "")


def _counted(counts: dict[str, str], name: str) -> str:
    return f", counts {counts[name]}" if name in counts else ""


def _range(least: int, most: int) -> str:
    return str(least) if least == most else f"{least} to {most}"
