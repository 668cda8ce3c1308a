"""The ``wirebond`` command: its options, its exit codes, and turning errors into sentences.

Exit codes: 0 done; 1 the input is wrong (protocol file, value, bytes without a frame); 2 wrong usage; 3 the port cannot
be opened or was lost; 130 ended by Ctrl-C where that is no normal end.
"""

from __future__ import annotations

import errno
import logging
import os
import sys
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from wirebond.cli.interrupts import EXIT_INTERRUPTED, raise_from_here
from wirebond.cli.numbers import amount, whole
from wirebond.cli.output import ReaderGone, console, drop, errors, fail, plain
from wirebond.errors import HeaderFileError, LinkDownError, PortError, ProtocolFileError, UsageError, WirebondError
from wirebond.visible import visible

EXIT_INPUT, EXIT_USAGE, EXIT_PORT = 1, 2, 3

app = typer.Typer(
    help="The serial link between a robot's computer and its microcontroller, from one protocol file.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit codes: 0 done, 1 wrong input, 2 wrong usage, 3 port trouble, 130 interrupted.",
)

ProtocolFile = Annotated[Path, typer.Argument(metavar="FILE", help="Protocol file (YAML).")]
Port = Annotated[
    str,
    typer.Argument(
        metavar="PORT",
        help="A tty such as /dev/ttyUSB0, usb:VENDOR:PRODUCT, tcp:// or rfc2217://HOST:PORT, replay:RECORDING.",
    ),
]
Baud = Annotated[
    int | None, typer.Option(parser=whole, metavar="INTEGER", help="Bits per second, instead of the file's.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for a program to read.")]
Header = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME=VALUE", help="Value of one of the frame's own fields (header); may be given often."),
]
Role = Annotated[str, typer.Option(metavar="END", help="The end that this computer plays: host or mcu.")]
Seconds = Annotated[
    float | None, typer.Option(parser=amount, metavar="NUMBER", help="End by itself after this many seconds.")
]


@app.command()
def check(
    file: ProtocolFile,
    as_json: AsJson = False,
    traffic: Annotated[
        str | None,
        typer.Option(
            metavar="LOAD",
            help="Assess this load, not the file's schedule: message=frames/s, or mcu:47=frames/s by frame size; "
            "several with commas.",
        ),
    ] = None,
    thorough: Annotated[bool, typer.Option("--thorough", help="Measure with twenty times as many samples.")] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Exit 1 for warnings, too.")] = False,
) -> None:
    """Say what is wrong with a protocol file, and what its link will do badly, in figures that are measured."""
    from wirebond.check.command import check_file

    raise_from_here()
    raise typer.Exit(check_file(file, as_json, traffic, thorough, strict))


@app.command()
def diff(
    old: Annotated[Path, typer.Argument(metavar="OLD", help="The protocol file as one end has it.")],
    new: Annotated[Path, typer.Argument(metavar="NEW", help="The changed file.")],
    updated: Annotated[
        str | None, typer.Option(help="The end that gets the new file first: host or mcu. Without it: either may.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say what a changed protocol file breaks while one end still has the old one. Exit 1 if it breaks."""
    from wirebond.diff.command import diff_files

    raise_from_here()
    raise typer.Exit(diff_files(old, new, as_json, updated))


@app.command()
def encode(
    file: ProtocolFile,
    message: Annotated[str, typer.Argument(help="Name of a message.")],
    values: Annotated[list[str] | None, typer.Argument(metavar="field=value…", help="Its fields, in SI units.")] = None,
    as_json: AsJson = False,
    sender: Annotated[
        str | None, typer.Option(help="Of a message of both ends: whose frame, mcu or host. Without it: the host's.")
    ] = None,
    header: Header = None,
) -> None:
    """Print the bytes of one frame as hex."""
    from wirebond.cli.commands import encode_message

    raise_from_here()
    encode_message(file, message, values or [], as_json, sender, header or [])


@app.command()
def decode(
    file: ProtocolFile,
    path: Annotated[str | None, typer.Argument(metavar="[PATH|-]", help="A capture of raw bytes; - for stdin.")] = None,
    sender: Annotated[str | None, typer.Option(help="Whose bytes these are: mcu or host. Without it: either.")] = None,
    hex_text: Annotated[str | None, typer.Option("--hex", help='The bytes themselves, as "AA 55 …".')] = None,
    expect: Annotated[
        str | None, typer.Option(help="The request that these bytes answer, where replies share an id.")
    ] = None,
    header: Header = None,
) -> None:
    """Print a JSON line for each message; the account of all bytes goes to stderr. Exit 1 if no frame came out."""
    from wirebond.cli.commands import decode_bytes

    raise_from_here()
    raise typer.Exit(decode_bytes(file, path, sender, hex_text, expect, header or []))


@app.command()
def explain(
    file: ProtocolFile,
    hex_text: Annotated[str, typer.Option("--hex", help='The bytes, as "AA 55 …".')],
    sender: Annotated[str | None, typer.Option(help="Whose bytes these are: mcu or host. Without it: either.")] = None,
    as_json: AsJson = False,
) -> None:
    """Name every byte of a frame; for refused bytes say which rule failed, and the nearest explanation."""
    from wirebond.explain.command import explain_bytes

    raise_from_here()
    raise typer.Exit(explain_bytes(file, hex_text, sender, as_json))


@app.command()
def identify(
    source: Annotated[
        str | None,
        typer.Argument(metavar="[PORT|FILE|-]", help="A port, a capture of raw bytes, or - for stdin."),
    ] = None,
    hex_text: Annotated[str | None, typer.Option("--hex", help='The bytes themselves, as "AA 55 …".')] = None,
    also: Annotated[
        list[Path] | None, typer.Option(metavar="PATH", help="Try this protocol file, or those of this folder, too.")
    ] = None,
    baud: Annotated[
        int | None, typer.Option(parser=whole, metavar="INTEGER", help="Of a port: try this rate alone.")
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(parser=amount, metavar="NUMBER", help="Of a port: listen so long at each rate; default 2."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say which known format these bytes are, or what a port sends at which rate. Exit 1 if none fits."""
    from wirebond.cli.identify_port import identify_port, is_port
    from wirebond.identify.command import identify_bytes

    raise_from_here()
    if source is not None and hex_text is None and is_port(source):
        raise typer.Exit(identify_port(source, baud, seconds, also or [], as_json))
    if baud is not None or seconds is not None:
        raise UsageError("--baud and --seconds are for ports; a capture has no rate")
    raise typer.Exit(identify_bytes(source, hex_text, also or [], as_json))


@app.command()
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
        typer.Option("--verbose", "-v", help="Also say what the port's driver made of baud rate, parity and latency."),
    ] = False,
) -> None:
    """Show what the other end sends: messages, rates, line use, statistics."""
    from wirebond.cli.live import monitor_port

    raise_from_here()
    monitor_port(file, port, baud, seconds, as_json, wait, role, dump_on_exit, verbose)


@app.command()
def dump(
    file: ProtocolFile,
    port: Port,
    baud: Baud = None,
    seconds: Seconds = None,
    as_json: AsJson = False,
) -> None:
    """Listen, and then print every byte with its time: frames, what was discarded and why. Exit 1 without a byte."""
    from wirebond.cli.dump import dump_port

    raise_from_here()
    raise typer.Exit(dump_port(file, port, baud, seconds, as_json))


@app.command()
def listen(
    file: ProtocolFile,
    host_port: Annotated[str, typer.Option(metavar="PORT", help="The port that hears what the host sends.")],
    mcu_port: Annotated[str, typer.Option(metavar="PORT", help="The port that hears what the MCU sends.")],
    baud: Baud = None,
    seconds: Seconds = None,
    as_json: AsJson = False,
    wait: Annotated[
        bool, typer.Option("--wait", help="Begin without the ports, and wait until they are there.")
    ] = False,
) -> None:
    """Show both directions of a line, with two ports that only receive: each message, and who sent it."""
    from wirebond.cli.listen import listen_to_both

    raise_from_here()
    listen_to_both(file, host_port, mcu_port, baud, seconds, as_json, wait)


@app.command()
def serve(
    file: ProtocolFile,
    port: Port,
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
            help="What clients at TCP must say. Beyond this computer one is needed, and made if none is given.",
        ),
    ] = None,
    hear: Annotated[str, typer.Option("--listen", help="own: frames for this end alone; all: every frame.")] = "own",
    record: Annotated[
        Path | None, typer.Option(metavar="PATH", help="Record the link to this new file, as `record` does.")
    ] = None,
    seconds: Seconds = None,
) -> None:
    """Own a port, and let many programs attach: each sees every message, and one at a time is in control."""
    from wirebond.cli.serve import serve_port

    raise_from_here()
    serve_port(file, port, baud, name, tcp, token, hear, record, seconds)


@app.command()
def record(
    file: ProtocolFile,
    port: Port,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="PATH", help="The new file. Default: PROTOCOL-DATE-TIME.mcap.")
    ] = None,
    minutes: Annotated[
        float | None, typer.Option(parser=amount, metavar="NUMBER", help="End by itself after this many minutes.")
    ] = None,
    baud: Baud = None,
    wait: Annotated[bool, typer.Option("--wait", help="Begin without the port, and wait until it is there.")] = False,
    role: Role = "host",
) -> None:
    """Record both directions of a link until Ctrl-C: raw bytes with their times, events, the protocol file."""
    from wirebond.cli.record import record_port

    raise_from_here()
    raise typer.Exit(record_port(file, port, out, baud, minutes, wait, role))


RecordingFile = Annotated[Path, typer.Argument(metavar="RECORDING", help="A file of `wirebond record`.")]
OtherProtocol = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Decode with this protocol file, not with the recording's own.")
]


@app.command()
def info(
    recording: RecordingFile,
    protocol: OtherProtocol = None,
    as_json: AsJson = False,
    no_repair: Annotated[
        bool, typer.Option("--no-repair", help="Leave a recording that was not closed as it is.")
    ] = False,
) -> None:
    """Say what a recording holds. One that was not closed is closed, and what was cut off is told."""
    from wirebond.recording.command import show_info

    raise_from_here()
    raise typer.Exit(show_info(recording, protocol, as_json, not no_repair))


@app.command(name="export")
def export_messages(
    recording: RecordingFile,
    to: Annotated[str, typer.Option(metavar="FORMAT", help="csv, parquet, or mcap with decoded JSON.")],
    message: Annotated[str | None, typer.Option(metavar="NAME", help="Only this message.")] = None,
    out: Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Folder; it is made if need be.")] = Path(),
    protocol: OtherProtocol = None,
) -> None:
    """Write the messages of a recording for other programs: a file for each message."""
    from wirebond.recording.command import export_recording

    raise_from_here()
    raise typer.Exit(export_recording(recording, to, message, out, protocol))


@app.command()
def replay(
    recording: RecordingFile,
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
        Path | None, typer.Option("-o", "--out", metavar="PATH", help="With --into: record what the firmware does.")
    ] = None,
) -> None:
    """Let a recording happen again: to a pty that any program opens as a port, or into a firmware."""
    from wirebond.cli.replay import replay_to_program, replay_to_pty, section_of

    raise_from_here()
    section = section_of(speed, start, stop, loop)
    if into is None:
        if out is not None:
            raise UsageError("--out goes with --into; to copy a recording, copy the file")
        raise typer.Exit(replay_to_pty(recording, section, sender, link))
    if pty or link is not None or loop or sender is not None:
        raise UsageError("--into takes the host's bytes once; --pty, --link, --loop and --sender do not go with it")
    raise typer.Exit(replay_to_program(recording, section, into, out))


@app.command()
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
) -> None:
    """Send a message, once or at a rate. If it asks for a reply, the reply is printed."""
    from wirebond.cli.live import send_message

    raise_from_here()
    raise typer.Exit(send_message(file, port, message, values or [], rate, baud, seconds, header or [], role))


param = typer.Typer(help="Read and set the parameters of the MCU.", no_args_is_help=True)
app.add_typer(param, name="param")
Timeout = Annotated[
    float | None, typer.Option(parser=amount, metavar="NUMBER", help="Seconds for each reply. Default: 1.")
]


@param.command(name="list")
def param_list(
    file: ProtocolFile,
    port: Port,
    baud: Baud = None,
    timeout: Timeout = None,
    header: Header = None,
    as_json: AsJson = False,
) -> None:
    """Print every parameter that the MCU has, with its value."""
    from wirebond.cli.param import Access, list_parameters

    raise_from_here()
    raise typer.Exit(list_parameters(Access(file, port, baud, timeout, header or [], as_json)))


@param.command(name="get")
def param_get(
    file: ProtocolFile,
    port: Port,
    names: Annotated[list[str], typer.Argument(metavar="NAME…", help="Names, or indices.")],
    baud: Baud = None,
    timeout: Timeout = None,
    header: Header = None,
    as_json: AsJson = False,
) -> None:
    """Print some parameters."""
    from wirebond.cli.param import Access, get_parameters

    raise_from_here()
    raise typer.Exit(get_parameters(Access(file, port, baud, timeout, header or [], as_json), names))


@param.command(name="set")
def param_set(
    file: ProtocolFile,
    port: Port,
    values: Annotated[list[str], typer.Argument(metavar="NAME=VALUE…", help="Names, or indices, and their values.")],
    baud: Baud = None,
    timeout: Timeout = None,
    header: Header = None,
    as_json: AsJson = False,
) -> None:
    """Set parameters, and print the values that the MCU acknowledges. Exit 1 if it refuses one."""
    from wirebond.cli.param import Access, set_parameters

    raise_from_here()
    raise typer.Exit(set_parameters(Access(file, port, baud, timeout, header or [], as_json), values))


@param.command(name="save")
def param_save(
    file: ProtocolFile,
    port: Port,
    out: Annotated[Path, typer.Argument(metavar="OUT", help="File to write: .yaml or .json.")],
    baud: Baud = None,
    timeout: Timeout = None,
    header: Header = None,
) -> None:
    """Read every parameter, and write them to a file."""
    from wirebond.cli.param import Access, save_parameters

    raise_from_here()
    raise typer.Exit(save_parameters(Access(file, port, baud, timeout, header or [], False), out))


@param.command(name="load")
def param_load(
    file: ProtocolFile,
    port: Port,
    source: Annotated[Path, typer.Argument(metavar="IN", help="File of names and values: .yaml or .json.")],
    baud: Baud = None,
    timeout: Timeout = None,
    header: Header = None,
    as_json: AsJson = False,
) -> None:
    """Set the parameters that a file has, after all of it was looked at. Exit 1 if something is refused."""
    from wirebond.cli.param import Access, load_parameters

    raise_from_here()
    raise typer.Exit(load_parameters(Access(file, port, baud, timeout, header or [], as_json), source))


@app.command()
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
    from wirebond.cli.latency import measure_latency

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


@app.command()
def sim(
    file: ProtocolFile,
    link: Annotated[Path | None, typer.Option(help="Also reach the pty under this name (a symbolic link).")] = None,
    seconds: Seconds = None,
    address: Annotated[
        list[str] | None,
        typer.Option(metavar="ADDRESS", help="Play the device of this address, or of several. Without it: of any."),
    ] = None,
    script: Annotated[
        Path | None, typer.Option(metavar="PATH", help="Python that says how it behaves; docs/simulation.md shows it.")
    ] = None,
    with_stats: Annotated[
        bool, typer.Option("--stats", help="At the end print as JSON what the MCU received and refused.")
    ] = False,
) -> None:
    """Run a virtual MCU that speaks this protocol, on a pty; print the pty's path."""
    from wirebond.cli.live import simulate

    raise_from_here()
    simulate(file, link, seconds, address or [], script, with_stats)


Ber = Annotated[
    float | None,
    typer.Option(parser=amount, metavar="CHANCE", help="Chance that a bit of the line is wrong, such as 1e-5."),
]
Bursts = Annotated[
    float | None,
    typer.Option(
        parser=amount, metavar="CHANCE", help="Chance of each byte that 16 bytes from it on become any bytes."
    ),
]
Drops = Annotated[float | None, typer.Option(parser=amount, metavar="CHANCE", help="Chance that a byte is lost.")]
Inserts = Annotated[
    float | None,
    typer.Option(
        parser=amount, metavar="CHANCE", help="Chance of each byte that one comes before it that was not sent."
    ),
]
Splits = Annotated[
    float | None,
    typer.Option(parser=amount, metavar="CHANCE", help="Chance that the line pauses for 2 ms behind a byte."),
]
FaultSeed = Annotated[
    int | None, typer.Option("--seed", parser=whole, metavar="INTEGER", help="Of the random faults. Default: 1.")
]


@app.command()
def wire(
    a: Annotated[Path, typer.Argument(metavar="A", help="Name for one end: a symbolic link to its pty.")],
    b: Annotated[Path, typer.Argument(metavar="B", help="Name for the other end.")],
    baud: Baud = None,
    line: Annotated[str, typer.Option(metavar="8N1", help="Data bits, parity and stop bits.")] = "8N1",
    baud_b: Annotated[
        int | None, typer.Option(parser=whole, metavar="N", help="End B runs at this rate, where it is a wrong one.")
    ] = None,
    line_b: Annotated[str | None, typer.Option(metavar="8E1", help="End B has this shape of a byte.")] = None,
    ber: Ber = None,
    bursts: Bursts = None,
    drops: Drops = None,
    inserts: Inserts = None,
    splits: Splits = None,
    seed: FaultSeed = None,
    batch: Annotated[
        float | None, typer.Option(parser=amount, metavar="MS", help="An adapter hands over at multiples of this time.")
    ] = None,
    jitter: Annotated[
        float | None, typer.Option(parser=amount, metavar="MS", help="And up to this much later, at random.")
    ] = None,
    unplug: Annotated[
        str | None, typer.Option(metavar="AT:FOR", help="Pull the cable after AT seconds, for FOR seconds.")
    ] = None,
    script: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Faults at times, one a line: `2.5 a_to_b drop 10`.")
    ] = None,
    seconds: Seconds = None,
    as_json: AsJson = False,
) -> None:
    """Join two ptys by a simulated wire with a baud rate and faults; say at the end what became of every byte."""
    from wirebond.wire.command import join_ptys, line_shape, unplugging
    from wirebond.wire.process import WireSettings
    from wirebond.wire.script import read_script

    raise_from_here()
    given = {"baud": baud, "ber": ber, "bursts": bursts, "drops": drops, "inserts": inserts, "splits": splits}
    given |= {"baud_b": baud_b, "seed": seed, "batch": None if batch is None else batch / 1000}
    given |= {"jitter": None if jitter is None else jitter / 1000}
    settings = WireSettings(
        line=line_shape(line),
        line_b=None if line_b is None else line_shape(line_b),
        unplug=None if unplug is None else unplugging(unplug),
        script=() if script is None else read_script(script),
        **_given(given),
    )
    join_ptys(a, b, settings, seconds, as_json)


def _given(values: dict[str, Any]) -> dict[str, Any]:
    """Without options that were not given: the settings have defaults."""
    return {name: value for name, value in values.items() if value is not None}


@app.command()
def soak(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="Protocol file; without it: enterprize.")
    ] = None,
    virtual: Annotated[
        bool,
        typer.Option("--virtual", help="Under virtual time, as fast as this machine can; without it in real time."),
    ] = False,
    minutes: Annotated[
        float | None,
        typer.Option(
            parser=amount, metavar="NUMBER", help="How long, by the line's clock. Default: 90, in real time 1."
        ),
    ] = None,
    load: Annotated[
        str,
        typer.Option(metavar="X|seed", help="Offer X times what the line carries; seed: the experiment's own rate."),
    ] = "1.2",
    baud: Baud = None,
    ber: Ber = None,
    bursts: Bursts = None,
    drops: Drops = None,
    inserts: Inserts = None,
    splits: Splits = None,
    seed: FaultSeed = None,
    jitter: Annotated[
        float | None,
        typer.Option(parser=amount, metavar="MS", help="The adapter hands over up to this much later, at random."),
    ] = None,
    report: Annotated[Path | None, typer.Option(help="Write a report in Markdown, and its plot beside it.")] = None,
    as_json: AsJson = False,
) -> None:
    """Offer more than the line carries at both ends, and account for every frame. Exit 1 if one is missing."""
    from wirebond.soak.command import soak_protocol
    from wirebond.soak.run import Settings

    raise_from_here()
    given = {"minutes": minutes, "baud": baud, "ber": ber, "bursts": bursts, "drops": drops, "inserts": inserts}
    if minutes is None and not virtual:
        given["minutes"] = 1.0
    given |= {"splits": splits, "seed": seed, "jitter": None if jitter is None else jitter / 1000}
    settings = Settings(virtual=virtual, **_given(given))
    raise typer.Exit(soak_protocol(file, load, settings, as_json, report))


@app.command()
def gen(
    file: ProtocolFile,
    out: Annotated[Path, typer.Option(help="Folder to write to; it is made if need be.")],
    lang: Annotated[str, typer.Option(help="Language of the generated code: cpp, c or python.")] = "cpp",
    amalgamate: Annotated[
        bool, typer.Option("--amalgamate", help="One header with the core in it (for c: .h and .cpp), no folder.")
    ] = False,
    port: Annotated[
        list[str] | None, typer.Option(help="Add this port's headers: stm32_hal, gd32_spl, freertos and others.")
    ] = None,
    only_check: Annotated[
        bool, typer.Option("--check", help="Write nothing; name the files that are not current, and exit 1 for them.")
    ] = False,
) -> None:
    """Generate code for a firmware or a host: a self-contained folder, one header, or a Python module."""
    from wirebond.gen.command import generate

    raise_from_here()
    raise typer.Exit(generate(file, lang, out, amalgamate, port or [], only_check))


@app.command()
def doc(
    file: ProtocolFile,
    out: Annotated[Path | None, typer.Option(help="File to write to; without it: stdout.")] = None,
) -> None:
    """Write the protocol's own document in Markdown, for people who write the other end without Wirebond."""
    from wirebond.doc.command import write_document

    raise_from_here()
    write_document(file, out)


@app.command()
def new(
    path: Annotated[Path, typer.Argument(metavar="PATH", help="The file to write; it must not exist.")],
    template: Annotated[str, typer.Option(help="native (recommended), fixed or length.")] = "native",
) -> None:
    """Write a commented first protocol file."""
    from wirebond.new.command import write_first_file

    raise_from_here()
    write_first_file(path, template)


@app.command(name="import")
def import_header(
    header: Annotated[Path, typer.Argument(metavar="HEADER.h", help="A C header with packed structs and enums.")],
    out: Annotated[Path | None, typer.Option(help="File to write to; it must not exist. Without it: stdout.")] = None,
) -> None:
    """Write a first protocol file from a C header's structs, with comments on what the header cannot tell."""
    from wirebond.import_.command import import_structs

    raise_from_here()
    import_structs(header, out)


@app.command()
def ports(as_json: AsJson = False) -> None:
    """List the serial ports of this machine, each with a name that it keeps. Exit 1 if there is none."""
    from wirebond.ports.command import list_ports

    raise_from_here()
    raise typer.Exit(list_ports(as_json))


@app.command()
def doctor(
    port: Annotated[
        str | None,
        typer.Argument(metavar="PORT", help="A tty, or a name such as usb:1a86:55d3. Without it: all ports."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say what is in the way of the serial ports on this machine, and how to cure it. Exit 1 for a problem."""
    from wirebond.ports.doctor.command import examine_machine

    raise_from_here()
    raise typer.Exit(examine_machine(port, as_json))


@app.command()
def demo(seconds: Seconds = None) -> None:
    """Drive a simulated rover over a tty and watch the link, until Ctrl-C."""
    from wirebond.cli.demo import run_demo

    raise_from_here()
    raise typer.Exit(run_demo(seconds))


def _version(wanted: bool) -> None:
    if wanted:
        from wirebond import __version__

        console.print(f"wirebond {__version__}")
        raise typer.Exit


def _cmakedir(wanted: bool) -> None:
    if wanted:
        from wirebond.paths import cmake

        sys.stdout.write(f"{cmake()}\n")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
    cmakedir: Annotated[
        bool,
        typer.Option(
            "--cmakedir", callback=_cmakedir, is_eager=True, help="Print the folder for CMake's wirebond_DIR and exit."
        ),
    ] = False,
) -> None:
    """The serial link between a robot's computer and its microcontroller, from one protocol file."""


def main(arguments: list[str] | None = None) -> int:
    """The whole command, to its exit code: every error that can be foreseen becomes a sentence."""
    logging.getLogger("wirebond").addHandler(logging.NullHandler())  # the commands say themselves what it would
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal of another encoding shows what it can
    code = _run(arguments)
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        drop(1)
    except OSError as error:
        drop(1)
        fail(_output_sentence(error))
        code = EXIT_INPUT
    return code


def _run(arguments: list[str] | None) -> int:
    try:
        return int(app(args=arguments, standalone_mode=False) or 0)
    except ReaderGone:
        return 0
    except SystemExit:  # of rich, whose reader has gone while it showed --help
        return 0
    except (KeyboardInterrupt, typer.Abort):
        return EXIT_INTERRUPTED
    except _USAGE_ERROR as error:
        return _wrong_usage(error)
    except (ProtocolFileError, HeaderFileError) as error:
        for problem in error.problems:
            errors.print(plain(str(problem)))
        return EXIT_INPUT
    except WirebondError as error:
        fail(str(error))
        port_trouble = isinstance(error, PortError | LinkDownError)
        return EXIT_PORT if port_trouble else EXIT_USAGE if isinstance(error, UsageError) else EXIT_INPUT
    except OSError as error:
        fail(_file_sentence(error))
        return EXIT_INPUT


# What typer raises for a wrong command line. It exports only this subclass, and which module has the base has changed.
_USAGE_ERROR = cast(type[Exception], typer.BadParameter.__bases__[0])


def _wrong_usage(error: BaseException) -> int:
    """Typer's sentence, with how the command is written. Where no argument was given, help is shown instead."""
    context = getattr(error, "ctx", None)
    if type(error).__name__ == "NoArgsIsHelpError":
        return EXIT_USAGE  # it has printed the help
    if context is not None:
        errors.print(plain(context.get_usage().strip()))
    fail(str(getattr(error, "format_message", error.__str__)()))
    if context is not None:
        errors.print(plain(f"`{context.command_path} --help` explains its arguments"))
    return EXIT_USAGE


_FILE_ADVICE = {
    errno.ENOENT: "there is no such file or folder; check the path",
    errno.ENOTDIR: "a part of this path is a file, not a folder; check the path",
    errno.EISDIR: "this is a folder; name a file in it",
    errno.EACCES: "you may not read or write here; check the permissions of the file and of its folder",
    errno.EPERM: "the system does not allow this; check the permissions of the file and of its folder",
    errno.EROFS: "this file system can only be read; name a place on another one",
    errno.ENOSPC: "no space is left on the disk; nothing was changed. Make room, or name a place on another disk",
    errno.EDQUOT: "your share of the disk is used up; nothing was changed. Make room, or name a place on another disk",
    errno.EFBIG: "the file would be larger than is allowed here; nothing was changed",
    errno.ELOOP: "this symbolic link leads back to itself; check the path",
    errno.ENAMETOOLONG: "the name is too long for this file system; name a shorter one",
}


def _file_sentence(error: OSError) -> str:
    if error.filename is None:
        return _output_sentence(error)
    what = _FILE_ADVICE.get(error.errno or 0, f"{error.strerror or error}; check the path")
    return f"{visible(os.fsdecode(error.filename))}: {what}"


def _output_sentence(error: OSError) -> str:
    drop(1)  # or what is still to be written fails once more when Python ends
    return f"the output cannot be written: {error.strerror or error}"


if __name__ == "__main__":
    sys.exit(main())
