"""Arguments and options that several groups of commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wirebond.cli.numbers import amount, whole

ProtocolFile = Annotated[Path, typer.Argument(metavar="FILE", help="Protocol file (YAML).")]
ProtocolFileOrStdin = Annotated[
    Path, typer.Argument(metavar="FILE", help="Protocol file (YAML), or - for stdin.", allow_dash=True)
]
Port = Annotated[
    str,
    typer.Argument(
        metavar="PORT",
        help="A tty such as /dev/ttyUSB0, usb:VENDOR:PRODUCT, tcp:// or rfc2217://HOST:PORT, replay:RECORDING, "
        "sim: (a simulated MCU), wirebond:// (a server's address).",
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
Seconds = Annotated[float | None, typer.Option(parser=amount, metavar="NUMBER", help="End after this many seconds.")]
Timeout = Annotated[
    float | None, typer.Option(parser=amount, metavar="NUMBER", help="Seconds for each reply. Default: 1.")
]
Web = Annotated[
    str | None,
    typer.Option(
        metavar="[HOST:]PORT",
        help="Serve the console there, for a browser. Default: 127.0.0.1:8765.",
    ),
]
Browser = Annotated[bool, typer.Option("--browser/--no-browser", help="Open the console in a browser.")]
