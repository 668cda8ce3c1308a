"""Commands for recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wirebond.cli.interrupts import raise_from_here
from wirebond.cli.options.shared import AsJson, Baud, Port, ProtocolFile, Role, Seconds
from wirebond.errors import UsageError

commands = typer.Typer()
RecordingFile = Annotated[
    Path,
    typer.Argument(
        metavar="RECORDING", help="A file of `wirebond record`; with --protocol a raw capture (.bin, .hex)."
    ),
]
OtherProtocol = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Decode with this protocol file, not with the recording's own. Captures need it."
    ),
]


@commands.command()
def record(
    file: ProtocolFile,
    port: Port,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="PATH", help="The new file. Default: PROTOCOL-DATE-TIME.mcap.")
    ] = None,
    seconds: Seconds = None,
    baud: Baud = None,
    wait: Annotated[bool, typer.Option("--wait", help="Begin without the port, and wait until it is there.")] = False,
    role: Role = "host",
) -> None:
    """Record both directions of a link until Ctrl-C: raw bytes with their times, events, the protocol file."""
    from wirebond.cli.commands.record import record_port

    raise_from_here()
    raise typer.Exit(record_port(file, port, out, baud, seconds, wait, role))


@commands.command()
def info(
    recording: RecordingFile,
    protocol: OtherProtocol = None,
    as_json: AsJson = False,
    no_repair: Annotated[
        bool, typer.Option("--no-repair", help="Leave a recording that was not closed as it is.")
    ] = False,
) -> None:
    """Say what a recording holds. One that was not closed is closed, and what was cut off is reported."""
    from wirebond.cli.commands.recordings import show_info

    raise_from_here()
    raise typer.Exit(show_info(recording, protocol, as_json, not no_repair))


@commands.command(name="export")
def export_messages(
    recording: RecordingFile,
    to: Annotated[
        str, typer.Option(metavar="FORMAT", help="csv, parquet, mcap with decoded JSON, or ros2 for a bag of ROS 2.")
    ],
    message: Annotated[str | None, typer.Option(metavar="NAME", help="Only this message.")] = None,
    out: Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Folder; it is made if need be.")] = Path(),
    protocol: OtherProtocol = None,
    mapping: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help="With ros2: which message is which topic, as for `serve --ros2`."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace what exists.")] = False,
) -> None:
    """Write the messages of a recording for other programs: a file for each message, or one with all."""
    raise_from_here()
    if to == "ros2":
        from wirebond.cli.commands.export_bag import export_bag

        raise typer.Exit(export_bag(recording, message, out, protocol, mapping, force))
    if mapping is not None:
        raise UsageError("--mapping is for `--to ros2`; leave it out")
    from wirebond.cli.commands.recordings import export_recording

    raise typer.Exit(export_recording(recording, to, message, out, protocol, force))


@commands.command()
def replay(
    recording: RecordingFile,
    protocol: OtherProtocol = None,
    speed: Annotated[str, typer.Option(metavar="X|max", help="Times as fast; max or 0: as fast as possible.")] = "1",
    start: Annotated[str | None, typer.Option("--from", metavar="12.5s", help="Begin here.")] = None,
    stop: Annotated[str | None, typer.Option("--to", metavar="20s", help="End here.")] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Again and again.")] = False,
    pty: Annotated[bool, typer.Option("--pty", help="To a pty, and print its path: the default.")] = False,
    link: Annotated[Path | None, typer.Option(help="Also reach the pty under this name (a symbolic link).")] = None,
    sender: Annotated[
        str | None, typer.Option(help="Whose bytes: mcu or host. Default: those that the link received.")
    ] = None,
    into: Annotated[
        Path | None,
        typer.Option(metavar="PROGRAM", help="Into a firmware that runs as a process under virtual time (--lockstep)."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="PATH", help="With --into: record the firmware's behaviour.")
    ] = None,
) -> None:
    """Let a recording happen again: to a pty that any program opens as a port, or into a firmware."""
    from wirebond.cli.commands.replay import replay_to_program, replay_to_pty, section_of

    raise_from_here()
    section = section_of(speed, start, stop, loop)
    if into is None:
        if out is not None:
            raise UsageError("--out goes with --into; to copy a recording, copy the file")
        raise typer.Exit(replay_to_pty(recording, protocol, section, sender, link))
    if pty or link is not None or loop or sender is not None:
        raise UsageError("--into takes the host's bytes once; --pty, --link, --loop and --sender do not go with it")
    raise typer.Exit(replay_to_program(recording, protocol, section, into, out))
