"""All HTTP requests of the console that are not the page's files."""

from __future__ import annotations

from starlette.routing import BaseRoute

from wirebond.console.about_bytes import ByteRequests
from wirebond.console.about_commands import CommandRequests
from wirebond.console.about_ports import PortRequests
from wirebond.console.about_protocol import ProtocolRequests
from wirebond.console.about_recordings import RecordingRequests
from wirebond.console.library import Library
from wirebond.console.station import Station


def routes(station: Station, library: Library) -> list[BaseRoute]:
    """By what they are about."""
    return [
        *ProtocolRequests(station).routes(),
        *ByteRequests(station, library).routes(),
        *RecordingRequests(station, library).routes(),
        *CommandRequests(station).routes(),
        *PortRequests(station).routes(),
    ]
