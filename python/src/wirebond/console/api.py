"""The HTTP requests of the console, except for the page's files."""

from __future__ import annotations

from starlette.routing import BaseRoute

from wirebond.console.about_bytes import ByteRequests
from wirebond.console.about_commands import CommandRequests
from wirebond.console.about_devices import DeviceRequests
from wirebond.console.about_ports import PortRequests
from wirebond.console.about_protocol import ProtocolRequests
from wirebond.console.about_recordings import RecordingRequests
from wirebond.console.about_samples import SampleRequests
from wirebond.console.connector import Connector
from wirebond.console.jobs import Worker
from wirebond.console.library import Library
from wirebond.console.station import Station


def routes(station: Station, library: Library, connector: Connector, worker: Worker) -> list[BaseRoute]:
    """Return the routes of all subjects."""
    return [
        *ProtocolRequests(station, library, connector.options, worker).routes(),
        *ByteRequests(station, library, worker).routes(),
        *DeviceRequests(station, worker).routes(),
        *RecordingRequests(library).routes(),
        *SampleRequests(station, library).routes(),
        *CommandRequests(station).routes(),
        *PortRequests(connector).routes(),
    ]
