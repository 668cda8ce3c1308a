"""Detects another program at the port of a link: it also reads from it, or changes its settings."""

from __future__ import annotations

from wirebond.analysis.diagnosis.finding import Diagnosis, Kind
from wirebond.link.devices.processes import named, other_users
from wirebond.link.dump import Dump


def changed_settings(dump: Dump) -> Diagnosis | None:
    """Detect that another program has changed the settings of the port; the link has restored them."""
    times = sum(piece.kind == "port_settings" for piece in dump.pieces)
    if not times:
        return None
    return Diagnosis(
        Kind.SHARED_PORT,
        "Another program changes the settings of this port",
        f"{times} time{'s' * (times != 1)}; the link restored them each time, and lost bytes until then",
        "Close that program: `stty`, a terminal or a service such as ModemManager. `wirebond doctor PORT` names those "
        "that have the port open.",
    )


def other_readers(tty: str) -> Diagnosis | None:
    """Detect other programs that have the port open now.

    :param tty: its path.
    """
    users = other_users(tty)
    if not users:
        return None
    return Diagnosis(
        Kind.SHARED_PORT,
        "Another program has this port open; if it reads from it, the link never sees those bytes",
        f"{named(users)} {'has' if len(users) == 1 else 'have'} {tty} open",
        f"End {'it' if len(users) == 1 else 'them'} with `kill {' '.join(str(one.pid) for one in users)}`; programs "
        "that share a line attach to `wirebond serve`.",
    )
