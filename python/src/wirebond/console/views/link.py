"""The link: its state in one glance, rates, accounts, clock."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import Any

import msgspec

from wirebond.as_json import plain
from wirebond.chinese import with_chinese
from wirebond.console.station import Served
from wirebond.console.views.view import Scene, View
from wirebond.link.ends import other
from wirebond.link.raw import is_raw
from wirebond.protocol.model import End

LINK_EVERY = 0.5  # seconds


class LinkView(View[bool]):
    _short: object = ()  # the state that a person wants to know at once, as it was sent last

    def round(self, scene: Scene) -> dict[str, Any] | None:
        served = scene.station.served
        short = None if served is None else _short_state(served)
        if not self._is_due(scene.now, LINK_EVERY) and short == self._short:
            return None
        self._next = scene.now + LINK_EVERY
        self._short = short
        return _no_link(scene.station.connecting) if served is None else _link_state(served)


def _short_state(served: Served) -> tuple[Any, ...]:
    """Return the facts whose changes a person wants to see at once."""
    link, server = served.link, served.server
    recording = server.recordings.current
    return link.state, link.why, link.stopped, server.holder, server.client_count, recording is not None


def _link_state(served: Served) -> dict[str, Any]:
    """Return the state of the link."""
    link, server, source = served.link, served.server, served.source
    stats = link.stats
    now = time.monotonic()
    line, clock, kept = link.line, link.clock, source.history.range()
    recording = server.recordings.current
    told = {
        "t": now,
        "wall": time.time(),
        "connected": True,
        "state": link.state,
        "why": link.why,
        "heard": source.heard(other(End(link.role))),
        "protocol": None if is_raw(link.codec) else link.codec.name,
        "hash": f"{link.codec.hash:016x}",
        "port": link.port,
        "baud": link.baud,
        "line": None if line is None else plain(line.as_dict()),
        "holder": server.holder,
        "clients": server.client_count,
        "stopped": link.stopped,
        "stopped_by": server.stopped_by,
        "struck": sorted(link.internals.inbox.struck()),
        "mcu_deadlines": source.mcu_deadlines.states(now),
        "rates": plain(link.rates().as_dict()),
        "receive": plain(stats.receive.as_dict()),
        "send": plain(asdict(stats.send)),
        "late": stats.late,
        "held_back": stats.held_back,
        "reconnects": stats.reconnects,
        "echoed_bytes": stats.echoed_bytes,
        "collisions": stats.collisions,
        "peer": with_chinese({"state": link.peer.state, "why": link.peer.why}, "why"),
        "clock": None if clock is None else plain(asdict(clock)),
        "round_trip": source.round_trips.figures(now),
        "recording": None if recording is None else msgspec.to_builtins(recording),
        "history": {
            "bytes": source.history.bytes,
            "most": source.history.most,
            "from": None if kept is None else kept[0],
            "lost": served.keeper.lost,
        },
    }
    return with_chinese(told, "why", "stopped_by")


def _no_link(connecting: dict[str, Any] | None) -> dict[str, Any]:
    """Return the same if there is no link."""
    tried = None if connecting is None else with_chinese(connecting, "why")
    return {"t": time.monotonic(), "wall": time.time(), "connected": False, "connecting": tried}
