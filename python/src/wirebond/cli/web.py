"""The console from the command line: where it listens, and the browser that shows it."""

from __future__ import annotations

import os
import re
import sys
import webbrowser
from collections.abc import Mapping
from typing import TYPE_CHECKING

from wirebond.cli.output import errors
from wirebond.errors import UsageError

if TYPE_CHECKING:
    from wirebond.console import Console

_ADDRESS = re.compile(r"([^/\s]*:)?\d+")
DEFAULT = "127.0.0.1:8765"


def web_address(text: str) -> tuple[str, int]:
    """Read host and port of ``--web``.

    :raises UsageError: it is neither a port nor HOST:PORT.
    """
    host, _, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not port.isdecimal() or len(port) > 5 or int(port) > 65535:
        raise UsageError(f"--web is {text!r:.80}; give nothing, then it is {DEFAULT}, or give PORT or HOST:PORT")
    return host or "127.0.0.1", int(port)


def with_web_address(arguments: list[str]) -> list[str]:
    """Insert the default of ``--web`` if no address follows it."""
    out = []
    for number, argument in enumerate(arguments):
        out.append(argument)
        following = arguments[number + 1] if number + 1 < len(arguments) else ""
        if argument == "--web" and not _ADDRESS.fullmatch(following):
            out.append(DEFAULT)
    return out


def show(console: Console, open_browser: bool) -> None:
    """Print the address, and open it where there is somebody to see it."""
    errors.print(f"Console: [bold]{console.address}[/]", soft_wrap=True)
    if not console.page_is_built:
        errors.print("Its page was not built; see docs/console.md. Programs can use it as it is.", soft_wrap=True)
    elif open_browser and has_display(os.environ):
        webbrowser.open(console.address)


def has_display(environment: Mapping[str, str]) -> bool:
    """Check whether a browser can be shown on this computer."""
    if sys.platform != "linux":
        return True
    return bool(environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY"))
