"""``wirebond param``: the parameters of the MCU."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wirebond.cli.interrupts import raise_from_here
from wirebond.cli.options.shared import AsJson, Baud, Header, Port, ProtocolFile, Timeout

commands = typer.Typer(help="Read and set the parameters of the MCU.", no_args_is_help=True)


@commands.command(name="list")
def param_list(
    file: ProtocolFile,
    port: Port,
    baud: Baud = None,
    timeout: Timeout = None,
    header: Header = None,
    as_json: AsJson = False,
) -> None:
    """Print every parameter that the MCU has, with its value."""
    from wirebond.cli.commands.param import Access, list_parameters

    raise_from_here()
    raise typer.Exit(list_parameters(Access(file, port, baud, timeout, header or [], as_json)))


@commands.command(name="get")
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
    from wirebond.cli.commands.param import Access, get_parameters

    raise_from_here()
    raise typer.Exit(get_parameters(Access(file, port, baud, timeout, header or [], as_json), names))


@commands.command(name="set")
def param_set(
    file: ProtocolFile,
    port: Port,
    values: Annotated[list[str], typer.Argument(metavar="NAME=VALUE…", help="Names, or indices, and their values.")],
    baud: Baud = None,
    timeout: Timeout = None,
    header: Header = None,
    as_json: AsJson = False,
) -> None:
    """Set parameters, all or none, and print the values that the MCU acknowledges. Exit 1 if one is refused."""
    from wirebond.cli.commands.param import Access, set_parameters

    raise_from_here()
    raise typer.Exit(set_parameters(Access(file, port, baud, timeout, header or [], as_json), values))


@commands.command(name="save")
def param_save(
    file: ProtocolFile,
    port: Port,
    out: Annotated[Path, typer.Argument(metavar="OUT", help="File to write: .yaml or .json.")],
    baud: Baud = None,
    timeout: Timeout = None,
    header: Header = None,
) -> None:
    """Read every parameter, and write them to a file."""
    from wirebond.cli.commands.param import Access, save_parameters

    raise_from_here()
    raise typer.Exit(save_parameters(Access(file, port, baud, timeout, header or [], False), out))


@commands.command(name="load")
def param_load(
    file: ProtocolFile,
    port: Port,
    source: Annotated[Path, typer.Argument(metavar="IN", help="File of names and values: .yaml or .json.")],
    baud: Baud = None,
    timeout: Timeout = None,
    header: Header = None,
    as_json: AsJson = False,
) -> None:
    """Set the parameters of a file, all or none. Exit 1 if one is refused."""
    from wirebond.cli.commands.param import Access, load_parameters

    raise_from_here()
    raise typer.Exit(load_parameters(Access(file, port, baud, timeout, header or [], as_json), source))
