"""The host's link: `link.py` sends, `receiving.py` and `aio.py` take, `inbox.py` says who gets each message."""

from wirebond.link.accounts import LinkStats, SendStats
from wirebond.link.dump import Dump, DumpEntry
from wirebond.link.line import LatencyTimer, Line, LowLatency
from wirebond.link.link import DEFAULT_HOLD, Link, open_link
from wirebond.link.rates import Rates
from wirebond.link.settings import engine_settings, safe_value

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
    "engine_settings",
    "open_link",
    "safe_value",
]
