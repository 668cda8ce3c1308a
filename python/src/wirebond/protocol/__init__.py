"""Protocol files: what they mean, how they are read. Nothing here needs the compiled engine."""

from wirebond.errors import Problem, ProtocolFileError
from wirebond.protocol.hash import protocol_hash
from wirebond.protocol.loader import load, loads
from wirebond.protocol.model import (
    Algorithm,
    ByteOrder,
    Deadline,
    EmergencyStop,
    End,
    Example,
    Field,
    FieldKind,
    Frame,
    LengthCounts,
    LinkSettings,
    Message,
    OnRange,
    Part,
    PartKind,
    PayloadRule,
    Protocol,
    Recover,
    Service,
)

__all__ = [
    "Algorithm",
    "ByteOrder",
    "Deadline",
    "EmergencyStop",
    "End",
    "Example",
    "Field",
    "FieldKind",
    "Frame",
    "LengthCounts",
    "LinkSettings",
    "Message",
    "OnRange",
    "Part",
    "PartKind",
    "PayloadRule",
    "Problem",
    "Protocol",
    "ProtocolFileError",
    "Recover",
    "Service",
    "load",
    "loads",
    "protocol_hash",
]
