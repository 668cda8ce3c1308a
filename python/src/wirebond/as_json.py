"""Values as JSON has them: bytes in hexadecimal, no NaN, no infinity."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import msgspec


def plain(value: Any) -> Any:
    """Return a value that `encode` can write, for any content."""
    if isinstance(value, dict):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(entry) for entry in value]
    if isinstance(value, bytes | bytearray):
        return value.hex()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    return value


def encode(value: Any) -> bytes:
    """Encode a result of `plain` as JSON."""
    return msgspec.json.encode(value)
