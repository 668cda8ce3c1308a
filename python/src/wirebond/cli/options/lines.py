"""Commands that open a port, or search for one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wirebond.cli.interrupts import raise_from_here
from wirebond.cli.numbers import amount, whole
from wirebond.cli.options.shared import (
    AsJson,
    Baud,
    Browser,
    Header,
    Port,
    ProtocolFile,
    Role,
    Seconds,
    Timeout,
    Web,
)
from wirebond.errors import UsageError

commands = typer.Typer()


@commands.command()
def monitor(
    file: ProtocolFile,
    port: Port,
    baud: Baud = None,
    seconds: Seconds = None,
    as_json: AsJson = False,
    wait: Annotated[bool, typer.Option("--wait", help="Begin without the port, and wait until it is there.")] = False,
    dump_on_exit: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help="At the end write the last bytes of the line here; .jsonl: as JSON."),
    ] = None,
    role: Role = "host",
    verbose: Annotated[
        bool,
        typer.Option(
            "--verbose", "-v", help="Also show the baud rate, parity and latency that the port's driver has set."
        ),
    ] = False,
) -> None:
    """Show what the other end sends: messages, rates, line use, statistics."""
    from wirebond.cli.commands.live import monitor_port

    raise_from_here()
    monitor_port(file, port, baud, seconds, as_json, wait, role, dump_on_exit, verbose)


@commands.command()
def dump(
    file: ProtocolFile,
    port: Port,
    baud: Baud = None,
    seconds: Seconds = None,
    as_json: AsJson = False,
) -> None:
    """Listen, and then print every byte with its time: frames, what was discarded and why. Exit 1 without a byte."""
    from wirebond.cli.commands.dump import dump_port

    raise_from_here()
    raise typer.Exit(dump_port(file, port, baud, seconds, as_json))


@commands.command()
def listen(
    file: ProtocolFile,
    host_port: Annotated[
        str | None, typer.Option(metavar="PORT", help="The port that receives the host's bytes.")
    ] = None,
    mcu_port: Annotated[
        str | None, typer.Option(metavar="PORT", help="The port that receives the MCU's bytes.")
    ] = None,
    port: Annotated[
        str | None, typer.Option(metavar="PORT", help="In place of these two: one that hears both, as on RS-485.")
    ] = None,
    baud: Baud = None,
    seconds: Seconds = None,
    as_json: AsJson = False,
    wait: Annotated[
        bool, typer.Option("--wait", help="Begin without the ports, and wait until they are there.")
    ] = False,
) -> None:
    """Show both directions of a line, with ports that only receive: each message with its sender."""
    from wirebond.cli.commands.listen import listen_to_both

    raise_from_here()
    given = (port,) if host_port is None and mcu_port is None else (host_port, mcu_port, port)
    if None in given[:2] or (len(given) == 3 and port is not None):
        raise UsageError("listen: give --host-port and --mcu-port, or --port for a line that both ends send on")
    listen_to_both(file, host_port, mcu_port, port, baud, seconds, as_json, wait)


@commands.command()
def serve(
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="FILE",
            help="Protocol file (YAML). Several, if the line carries several formats. With --web the page can choose.",
        ),
    ] = None,
    port: Annotated[
        str | None, typer.Argument(metavar="PORT", help="As for `monitor`. With --web the page can choose it.")
    ] = None,
    baud: Baud = None,
    name: Annotated[
        str | None, typer.Option(help="Programs attach to wirebond://NAME. Default: the protocol's name.")
    ] = None,
    tcp: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="Listen there as well; port 0: any that is free.")
    ] = None,
    token: Annotated[
        str | None,
        typer.Option(
            envvar="WIREBOND_TOKEN",
            help="The token that clients over TCP and the console's page must present. Default: one is made and "
            "printed.",
        ),
    ] = None,
    hear: Annotated[str, typer.Option("--listen", help="own: frames for this end alone; all: every frame.")] = "own",
    record: Annotated[
        Path | None, typer.Option(metavar="PATH", help="Record the link to this new file, as `record` does.")
    ] = None,
    recordings: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Let clients start and stop recordings, in this folder.")
    ] = None,
    web: Web = None,
    browser: Browser = True,
    ros2: Annotated[
        bool, typer.Option("--ros2", help="Be a ROS 2 node: messages are topics. It needs no ROS on this computer.")
    ] = False,
    mapping: Annotated[
        Path | None,
        typer.Option(
            metavar="PATH",
            help="Which message is which topic; implies --ros2. Default: ros2/FILE beside FILE, if there.",
        ),
    ] = None,
    seconds: Seconds = None,
) -> None:
    """Own a port, and let many programs attach: each sees every message, and one at a time is in control."""
    from wirebond.cli.commands.serve import Serving, serve_port

    raise_from_here()
    serve_port(
        Serving(
            files or [], port, baud, name, tcp, token, hear, record, recordings, web, browser, ros2, mapping, seconds
        )
    )


@commands.command()
def send(
    file: ProtocolFile,
    port: Port,
    message: Annotated[str, typer.Argument(help="Name of a message that this end sends.")],
    values: Annotated[list[str] | None, typer.Argument(metavar="field=value…", help="Its fields, in SI units.")] = None,
    rate: Annotated[
        float | None,
        typer.Option(parser=amount, metavar="NUMBER", help="Send again and again, this many times a second."),
    ] = None,
    baud: Baud = None,
    seconds: Seconds = None,
    header: Header = None,
    role: Role = "host",
    hand_over: Annotated[
        bool, typer.Option("--hand-over", help="Send no safe value at the end: leave the robot as it is.")
    ] = False,
) -> None:
    """Send a message, once or at a rate. If it asks for a reply, the reply is printed. At the end, what the message
    moved gets its safe value."""
    from wirebond.cli.commands.live import send_message

    raise_from_here()
    raise typer.Exit(
        send_message(file, port, message, values or [], rate, baud, seconds, header or [], role, hand_over)
    )


@commands.command()
def stop(
    server: Annotated[str, typer.Argument(metavar="SERVER", help="A running server: wirebond://NAME.")],
    release: Annotated[bool, typer.Option("--release", help="Release the stop instead.")] = False,
    over: Annotated[
        bool, typer.Option("--over", help="With --release: also if another program stopped the robot.")
    ] = False,
) -> None:
    """Stop the robot of a running server. The stop holds for all programs, also after a restart of the server."""
    from wirebond.cli.commands.stop import stop_robot

    raise_from_here()
    raise typer.Exit(stop_robot(server, release, over))


@commands.command()
def latency(
    file: ProtocolFile,
    port: Port,
    values: Annotated[
        list[str] | None, typer.Argument(metavar="field=value…", help="Fields of --message, in SI units.")
    ] = None,
    message: Annotated[
        str | None, typer.Option(metavar="NAME", help="Ask with this request; without it: the ping service.")
    ] = None,
    count: Annotated[
        int | None,
        typer.Option(
            parser=whole, metavar="INTEGER", help="How many requests. Default: 1000; no limit with --seconds."
        ),
    ] = None,
    rate: Annotated[
        float | None, typer.Option(parser=amount, metavar="NUMBER", help="Requests a second. Default: 100.")
    ] = None,
    seconds: Seconds = None,
    timeout: Timeout = None,
    plot: Annotated[Path | None, typer.Option(metavar="PATH", help="Draw a picture: .png, .svg or .pdf.")] = None,
    baud: Baud = None,
    header: Header = None,
    as_json: AsJson = False,
) -> None:
    """Measure how long replies take: percentiles and a histogram. Exit 1 if no reply came."""
    from wirebond.cli.commands.latency import measure_latency

    raise_from_here()
    raise typer.Exit(
        measure_latency(
            file,
            port,
            values or [],
            message=message,
            header_words=header or [],
            count=count,
            rate=rate,
            seconds=seconds,
            timeout=timeout,
            baud=baud,
            as_json=as_json,
            plot=plot,
        )
    )


@commands.command()
def ports(as_json: AsJson = False) -> None:
    """List the serial ports of this machine, each with a name that it keeps. Exit 1 if there is none."""
    from wirebond.cli.commands.ports import list_ports

    raise_from_here()
    raise typer.Exit(list_ports(as_json))


@commands.command()
def doctor(
    port: Annotated[
        str | None,
        typer.Argument(metavar="PORT", help="A tty, or a name such as usb:1a86:55d3. Without it: all ports."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say what is in the way of the serial ports on this machine, and how to cure it. Exit 1 for a problem."""
    from wirebond.cli.commands.doctor import examine_machine

    raise_from_here()
    raise typer.Exit(examine_machine(port, as_json))
