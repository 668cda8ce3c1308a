"""The host's link: `link.py` sends, `receiving.py` and `aio.py` take, `inbox.py` routes each message.

Names are imported when first used: the serial ports of a machine are listed and named without the engine.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wirebond.link.accounts import LinkStats, SendStats
    from wirebond.link.dump import Dump, DumpEntry
    from wirebond.link.line import LatencyTimer, Line, LowLatency
    from wirebond.link.link import DEFAULT_HOLD, Link, open_link
    from wirebond.link.rates import Rates

__all__ = [
    "DEFAULT_HOLD",
    "Dump",
    "DumpEntry",
    "LatencyTimer",
    "Line",
    "Link",
    "LinkStats",
    "LowLatency",
    "Rates",
    "SendStats",
    "open_link",
]

_HOMES = {
    name: module
    for module, names in {
        "accounts": ("LinkStats", "SendStats"),
        "dump": ("Dump", "DumpEntry"),
        "line": ("LatencyTimer", "Line", "LowLatency"),
        "link": ("DEFAULT_HOLD", "Link", "open_link"),
        "rates": ("Rates",),
    }.items()
    for name in names
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
