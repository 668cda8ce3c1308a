"""Commands for protocol files and for bytes; nothing here opens a port, but `identify`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wirebond.cli.interrupts import raise_from_here
from wirebond.cli.numbers import amount, whole
from wirebond.cli.options.shared import AsJson, Header, ProtocolFile, ProtocolFileOrStdin
from wirebond.errors import UsageError

commands = typer.Typer()


@commands.command()
def check(
    file: ProtocolFileOrStdin,
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
    layout: Annotated[
        bool, typer.Option("--layout", help="Show instead which bytes of each payload have which value.")
    ] = False,
) -> None:
    """Say what is wrong with a protocol file, and what its link will do badly, in figures that are measured."""
    from wirebond.cli.commands.check import check_file

    raise_from_here()
    raise typer.Exit(check_file(file, as_json, traffic, thorough, strict, layout))


@commands.command()
def diff(
    old: Annotated[Path, typer.Argument(metavar="OLD", help="The protocol file as one end has it, or - for stdin.")],
    new: Annotated[Path, typer.Argument(metavar="NEW", help="The changed file, or - for stdin.")],
    updated: Annotated[
        str | None, typer.Option(help="The end that gets the new file first: host or mcu. Without it: either may.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say what a changed protocol file breaks while one end still has the old one. Exit 1 if it breaks."""
    from wirebond.cli.commands.diff import diff_files

    raise_from_here()
    raise typer.Exit(diff_files(old, new, as_json, updated))


@commands.command()
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
    from wirebond.cli.commands.files import encode_message

    raise_from_here()
    encode_message(file, message, values or [], as_json, sender, header or [])


@commands.command()
def decode(
    file: ProtocolFile,
    path: Annotated[str | None, typer.Argument(metavar="[PATH|-]", help="A capture of raw bytes; - for stdin.")] = None,
    sender: Annotated[str | None, typer.Option(help="Whose bytes these are: mcu or host. Without it: either.")] = None,
    hex_text: Annotated[str | None, typer.Option("--hex", help='The bytes themselves, as "AA 55 …".')] = None,
    expect: Annotated[
        str | None, typer.Option(help="The request that these bytes answer, if replies share an id.")
    ] = None,
    header: Header = None,
) -> None:
    """Print a JSON line for each message; the account of all bytes goes to stderr. Exit 1 if no frame came out."""
    from wirebond.cli.commands.files import decode_bytes

    raise_from_here()
    raise typer.Exit(decode_bytes(file, path, sender, hex_text, expect, header or []))


@commands.command()
def explain(
    file: ProtocolFile,
    source: Annotated[
        str | None,
        typer.Argument(metavar='["AA 55 …"|PATH|-]', help="The bytes; or a capture, a recording, or - for stdin."),
    ] = None,
    hex_text: Annotated[str | None, typer.Option("--hex", help='The bytes, as "AA 55 …".')] = None,
    sender: Annotated[str | None, typer.Option(help="Whose bytes these are: mcu or host. Without it: either.")] = None,
    as_json: AsJson = False,
) -> None:
    """Name every byte of a frame; for refused bytes say which rule failed, and the nearest explanation."""
    from wirebond.cli.commands.explain import explain_bytes

    raise_from_here()
    raise typer.Exit(explain_bytes(file, source, hex_text, sender, as_json))


@commands.command()
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
    from wirebond.cli.commands.identify import identify_bytes
    from wirebond.cli.commands.identify_port import identify_port, is_port

    raise_from_here()
    if source is not None and hex_text is None and is_port(source):
        raise typer.Exit(identify_port(source, baud, seconds, also or [], as_json))
    if baud is not None or seconds is not None:
        raise UsageError("--baud and --seconds are for ports; a capture has no rate")
    raise typer.Exit(identify_bytes(source, hex_text, also or [], as_json))


@commands.command()
def infer(
    source: Annotated[
        str | None,
        typer.Argument(metavar='["AA 55 …"|PATH|-]', help="A capture, a recording, - for stdin, or the bytes."),
    ] = None,
    hex_text: Annotated[str | None, typer.Option("--hex", help='The bytes themselves, as "AA 55 …".')] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write to; it must not exist. Without it: stdout.")
    ] = None,
    sender: Annotated[
        str | None, typer.Option(help="Whose bytes these are: mcu or host. Without it: the MCU's.")
    ] = None,
) -> None:
    """Write a first protocol file for bytes of an undocumented format. Exit 1 if nothing repeats in them."""
    from wirebond.cli.commands.infer import infer_file

    raise_from_here()
    raise typer.Exit(infer_file(source, hex_text, out, sender))


@commands.command()
def gen(
    file: ProtocolFile,
    out: Annotated[Path, typer.Option(help="Folder to write to; it is made if need be.")],
    lang: Annotated[
        str,
        typer.Option(help="cpp, c or python; ros2: a package of messages; page: a console that needs no server."),
    ] = "cpp",
    amalgamate: Annotated[
        bool, typer.Option("--amalgamate", help="One header with the core in it (for c: .h and .cpp), no folder.")
    ] = False,
    port: Annotated[
        list[str] | None,
        typer.Option(
            help="Add a port's files: arduino, bare_metal, freertos, gd32_spl, posix, stm32_hal, stm32_ll, usb_cdc."
        ),
    ] = None,
    uart: Annotated[str | None, typer.Option(help="With --starter: the UART, such as USART3.")] = None,
    starter: Annotated[
        bool, typer.Option("--starter", help="Also write a first source file with empty handlers, which is yours.")
    ] = False,
    only_check: Annotated[
        bool, typer.Option("--check", help="Write nothing; name the files that are not current, and exit 1 for them.")
    ] = False,
) -> None:
    """Generate code for a firmware or a host: a self-contained folder, one header, a Python module, or a package."""
    from wirebond.cli.commands.gen import Starter, generate

    raise_from_here()
    if starter != (uart is not None):
        raise UsageError("--starter and --uart go together: `--port stm32_hal --uart USART3 --starter`")
    first = Starter(uart) if uart is not None else None
    raise typer.Exit(generate(file, lang, out, amalgamate, port or [], only_check, first))


@commands.command()
def doc(
    file: ProtocolFile,
    out: Annotated[Path | None, typer.Option(help="File to write to; without it: stdout.")] = None,
    language: Annotated[str, typer.Option(help="en or zh (Chinese).")] = "en",
) -> None:
    """Write the protocol's own document in Markdown, for people who write the other end without Wirebond."""
    from wirebond.cli.commands.doc import write_document

    raise_from_here()
    write_document(file, out, language)


@commands.command()
def schema(
    mapping: Annotated[bool, typer.Option("--mapping", help="Of mapping files for ROS 2.")] = False,
    out: Annotated[Path | None, typer.Option(help="File to write to; without it: stdout.")] = None,
) -> None:
    """Print the JSON Schema of protocol files, with which editors complete and check keys."""
    from wirebond.cli.commands.schema import write_schema

    raise_from_here()
    write_schema(mapping, out)


@commands.command()
def new(
    path: Annotated[Path, typer.Argument(metavar="PATH", help="The file to write; it must not exist.")],
    has: Annotated[
        str | None,
        typer.Option(
            metavar="PARTS",
            help="Parts of the robot, separated by commas: base, joints=N, imu, battery. Default: base,imu,battery.",
        ),
    ] = None,
    template: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Its frames: native (recommended), length or fixed. Or a public format, such as tfmini: the file is a "
            "copy of Wirebond's.",
        ),
    ] = "native",
    port: Annotated[
        str | None,
        typer.Option(help="The robot's port, for the commands that are shown at the end, such as /dev/ttyACM0."),
    ] = None,
) -> None:
    """Write a commented first protocol file for a robot of your own, or a copy of a public format."""
    from wirebond.cli.commands.new import write_first_file

    raise_from_here()
    write_first_file(path, has, template, port)


@commands.command(name="import")
def import_header(
    header: Annotated[Path, typer.Argument(metavar="HEADER.h", help="A C header with packed structs and enums.")],
    out: Annotated[Path | None, typer.Option(help="File to write to; it must not exist. Without it: stdout.")] = None,
) -> None:
    """Write a first protocol file from a C header's structs, with comments on what the header cannot tell."""
    from wirebond.cli.commands.import_ import import_structs

    raise_from_here()
    import_structs(header, out)
