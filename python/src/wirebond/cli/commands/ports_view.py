"""Shows ports to a person: two lines for each, and a third for a problem."""

from __future__ import annotations

from typing import Any

from wirebond.cli.output import console, plain

_NONE = """\
There is no serial port on this machine.
Check that the board is plugged in and has power, and that its USB cable carries data:
some only charge. `wirebond doctor` finds the obstacle on this machine."""


_NOT_HERE = """\
Ports are listed from /sys/class/tty, which only Linux has.
Name the port by its path, such as COM3 or /dev/cu.usbmodem1."""


def print_ports(rows: list[dict[str, Any]], can_list: bool) -> None:
    """Print the ports. `rows`: the JSON of each port. `can_list`: whether this system shows its ports."""
    if not rows:
        console.print(_lines(_NONE if can_list else _NOT_HERE), soft_wrap=True)
        return
    width = max(len("port"), *(len(row["path"]) for row in rows))
    console.print(f"[dim]{'port':<{width}}  its kind, and its permanent name[/]")
    for row in rows:
        driver = f", driver {row['driver']}" if row["driver"] else ""
        shown = plain(f"{row['description']}{driver}")
        console.print(f"[bold]{plain(row['path']):<{width}}[/]  {shown}", soft_wrap=True)
        if row["name"] != row["path"]:
            console.print(f"{'':<{width}}  [cyan]{plain(row['name'])}[/]", soft_wrap=True)
        if obstacle := _obstacle(row):
            console.print(f"{'':<{width}}  [yellow]{plain(obstacle)}[/]", soft_wrap=True)


def _lines(text: str) -> str:
    return "\n".join(plain(line) for line in text.splitlines())


def _obstacle(row: dict[str, Any]) -> str | None:
    doctor = f"`wirebond doctor {row['path']}` shows the remedy"
    if not row["has_device"]:
        return f"there is no file {row['path']}; {doctor}"
    if not row["may_open"]:
        return f"you may not open it; {doctor}"
    return None
