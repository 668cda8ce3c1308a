"""Wirebond: the serial link between a robot's computer and its microcontroller, from one protocol file.

>>> proto = wirebond.load("protocols/diffdrive.yaml")
>>> proto.encode("velocity", linear=0.5, angular=0.0).hex()
'aa5501f401000000000b0d'
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from wirebond.analysis.diagnosis import Diagnosis, diagnose
    from wirebond.codec import (
        Codec,
        Columns,
        Decoder,
        Message,
        SequenceCounts,
        SequenceStats,
        Stats,
        Table,
        load,
    )
    from wirebond.errors import (
        EngineError,
        LateCommandError,
        LinkDownError,
        MessageError,
        NotInControlError,
        ParameterError,
        PortError,
        ProtocolFileError,
        ProtocolMismatchError,
        QueueFullError,
        RequestTimeoutError,
        StoppedByOtherError,
        StoppedError,
        UsageError,
        WirebondError,
    )
    from wirebond.link import Dump, DumpEntry, LatencyTimer, Line, Link, LinkStats, LowLatency, Rates, SendStats
    from wirebond.link import open_link as open
    from wirebond.link.aio import Aio
    from wirebond.link.attached.words import Control
    from wirebond.link.clock_line import HostTime
    from wirebond.link.clock_sync import ClockReading
    from wirebond.link.common_port import CommonPort
    from wirebond.link.handlers import DeadlineEvent
    from wirebond.link.inbox import Latest
    from wirebond.link.listen import Heard, Listener, listen
    from wirebond.link.log_lines import LogEvent
    from wirebond.link.parameters import Parameters
    from wirebond.link.peer import Peer
    from wirebond.protocol.counter_values import McuCounters
    from wirebond.protocol.log import LogLine
    from wirebond.recording import Recorder, Recording
    from wirebond.server import Server

__version__ = "0.1.0"

__all__ = [
    "Aio",
    "ClockReading",
    "Codec",
    "Columns",
    "CommonPort",
    "Control",
    "DeadlineEvent",
    "Decoder",
    "Diagnosis",
    "Dump",
    "DumpEntry",
    "EngineError",
    "Heard",
    "HostTime",
    "LateCommandError",
    "LatencyTimer",
    "Latest",
    "Line",
    "Link",
    "LinkDownError",
    "LinkStats",
    "Listener",
    "LogEvent",
    "LogLine",
    "LowLatency",
    "McuCounters",
    "Message",
    "MessageError",
    "NotInControlError",
    "ParameterError",
    "Parameters",
    "Peer",
    "PortError",
    "ProtocolFileError",
    "ProtocolMismatchError",
    "QueueFullError",
    "Rates",
    "Recorder",
    "Recording",
    "RequestTimeoutError",
    "SendStats",
    "SequenceCounts",
    "SequenceStats",
    "Server",
    "Stats",
    "StoppedByOtherError",
    "StoppedError",
    "Table",
    "UsageError",
    "WirebondError",
    "diagnose",
    "listen",
    "load",
    "open",
]

# The module that has each name. They are imported when first asked for: the command must be able to begin without them.
_HOMES = {
    name: module
    for module, names in {
        "link.aio": ("Aio",),
        "codec": (
            "Codec",
            "Columns",
            "Decoder",
            "Message",
            "SequenceCounts",
            "SequenceStats",
            "Stats",
            "Table",
            "load",
        ),
        "protocol.counter_values": ("McuCounters",),
        "analysis.diagnosis": ("Diagnosis", "diagnose"),
        "errors": tuple(name for name in __all__ if name.endswith("Error")),
        "link.clock_line": ("HostTime",),
        "link.clock_sync": ("ClockReading",),
        "link.common_port": ("CommonPort",),
        "link.handlers": ("DeadlineEvent",),
        "link.inbox": ("Latest",),
        "link.listen": ("Heard", "Listener", "listen"),
        "link.log_lines": ("LogEvent",),
        "link.parameters": ("Parameters",),
        "link.peer": ("Peer",),
        "link": (
            "Dump",
            "DumpEntry",
            "LatencyTimer",
            "Line",
            "Link",
            "LinkStats",
            "LowLatency",
            "Rates",
            "SendStats",
            "open",
        ),
        "protocol.log": ("LogLine",),
        "link.attached.words": ("Control",),
        "server": ("Server",),
        "recording": ("Recorder", "Recording"),
    }.items()
    for name in names
}


def __getattr__(name: str) -> object:
    if name == "_engine":
        return _load_engine()
    if name == "recording":  # a module: `wirebond.recording.open`
        return import_module("wirebond.recording")
    if name not in _HOMES:
        raise AttributeError(f"module 'wirebond' has no attribute {name!r}")
    found: object = getattr(import_module(f"wirebond.{_HOMES[name]}"), "open_link" if name == "open" else name)
    globals()[name] = found
    return found


def _load_engine() -> object:
    """Load the engine for ``from wirebond import _engine``, after checking that it fits."""
    engine_interface = import_module("wirebond.engine_interface")
    try:
        engine = import_module("wirebond._engine")
        engine_interface.verify(engine)
    except ModuleNotFoundError as error:
        if error.name != "wirebond._engine":
            raise
        from wirebond.errors import EngineError  # noqa: PLC0415

        raise EngineError("the compiled engine is missing; run `make setup` in the repository") from None
    except ImportError:
        globals().pop("_engine", None)  # the next import shall not find it there
        raise
    return engine


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
