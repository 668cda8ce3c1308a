"""All HTTP requests of the console that are not the page's files."""

from __future__ import annotations

import asyncio

from starlette.routing import BaseRoute

from wirebond.console.about_bytes import ByteRequests
from wirebond.console.about_commands import CommandRequests
from wirebond.console.about_devices import DeviceRequests
from wirebond.console.about_ports import PortRequests
from wirebond.console.about_protocol import ProtocolRequests
from wirebond.console.about_recordings import RecordingRequests
from wirebond.console.connector import Connector
from wirebond.console.library import Library
from wirebond.console.station import Station


def routes(station: Station, library: Library, connector: Connector) -> list[BaseRoute]:
    """By what they are about."""
    turn = asyncio.Lock()  # what takes long goes one at a time: the link has the rest of the computer
    return [
        *ProtocolRequests(station, connector.options.may_save).routes(),
        *ByteRequests(station, library, turn).routes(),
        *DeviceRequests(station, turn).routes(),
        *RecordingRequests(station, library).routes(),
        *CommandRequests(station).routes(),
        *PortRequests(connector).routes(),
    ]
