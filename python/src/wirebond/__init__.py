"""Wirebond: the serial link between a robot's computer and its microcontroller, from one protocol file.

>>> proto = wirebond.load("protocols/diffdrive.yaml")
>>> proto.encode("velocity", linear=0.5, angular=0.0).hex()
'aa5501f401000000000b0d'
"""

from wirebond.codec import Codec, Columns, Decoder, Message, Stats, Table, load
from wirebond.errors import (
    LinkDownError,
    MessageError,
    PortError,
    ProtocolFileError,
    ProtocolMismatchError,
    QueueFullError,
    StoppedError,
    UsageError,
    WirebondError,
)
from wirebond.link import Link, LinkStats, SendStats
from wirebond.link import open_link as open
from wirebond.log import LogLine

__version__ = "0.1.0"

__all__ = [
    "Codec",
    "Columns",
    "Decoder",
    "Link",
    "LinkDownError",
    "LinkStats",
    "LogLine",
    "Message",
    "MessageError",
    "PortError",
    "ProtocolFileError",
    "ProtocolMismatchError",
    "QueueFullError",
    "SendStats",
    "Stats",
    "StoppedError",
    "Table",
    "UsageError",
    "WirebondError",
    "load",
    "open",
]
