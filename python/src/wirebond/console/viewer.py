"""What one client of ``/views`` gets, round by round: only what it wants, and only what is new. No socket."""

from __future__ import annotations

import time
from typing import Any

import msgspec

from wirebond.as_json import encode
from wirebond.chinese import with_chinese
from wirebond.console.library import Library, Replay
from wirebond.console.link_state import link_state, no_link, short_state
from wirebond.console.plots import PlotFeed
from wirebond.console.station import Served, Station
from wirebond.console.tables import frame_entries, message_rows
from wirebond.console.wants import OfRecording, Plot, Views
from wirebond.errors import UsageError, WirebondError
from wirebond.recording.history.source import Source

LINK_EVERY = 0.5  # seconds
FRAMES_EVERY = 0.1
SPARKS_EVERY = 0.5
ROUND_EVERY = 1 / 30  # seconds: a client gets no more rounds


class Viewer:
    """One thread at a time."""

    def __init__(self, station: Station, library: Library) -> None:
        self._station = station
        self._library = library
        self._wants = Views()
        self._replay: Replay | None = None
        self._of: object = None  # the source that was shown last
        self._plots: dict[str, PlotFeed] = {}
        self._due: dict[str, float] = {}
        self._shown: dict[str, Any] = {}  # what was sent last of each view, to see whether it changed
        self._out: list[str | bytes] = []

    def want(self, views: Views) -> None:
        """From now on the client wants this."""
        before, self._wants = self._wants, views
        if views.source != before.source:
            self._choose(views)
        if views.at != before.at or views.messages != before.messages or views.frames != before.frames:
            self._due.pop("messages", None)
            self._due.pop("frames", None)
            self._shown.pop("frames", None)
        if not views.events:
            self._shown.pop("events", None)
        if not views.marks:
            self._shown.pop("marks", None)
        if not views.link:
            self._due.pop("link", None)
        before_plots = {plot.id: plot for plot in before.plots}
        feeds, self._plots = self._plots, {}
        for plot in views.plots:
            is_same = plot.id in feeds and before_plots.get(plot.id) == plot
            self._plots[plot.id] = feeds[plot.id] if is_same else self._feed(plot)

    def round(self) -> list[str | bytes]:
        """What the client lacks now: messages, in their order."""
        wants, now = self._wants, time.monotonic()
        served = self._station.served
        source = self._source()
        if source is not self._of:
            self._of = source
            self._forget()
        if wants.link:
            self._link(served, now)
        if source is None:
            return self._taken()
        shown = now if self._replay is None else (wants.at if wants.at is not None else self._replay.duration)
        at = None if self._replay is None else shown
        if wants.messages is not None and self._is_due("messages", now, wants.messages.every):
            self._messages(source, shown, at, now)
        if wants.frames is not None and self._is_due("frames", now, FRAMES_EVERY):
            entries = frame_entries(source, wants.frames.most, wants.frames.message, wants.frames.discards, at)
            marks = [(e["n"], e["direction"], e["size"]) for e in entries]
            if self._shown.get("frames") != marks:
                self._shown["frames"] = marks
                self._tell({"view": "frames", "t": shown, "entries": entries})
        if wants.events:
            self._events(source, at)
        if wants.marks:
            self._marks(source)
        for feed in self._plots.values():
            self._plot(feed, source, now)
        return self._taken()

    # ---- views

    def _link(self, served: Served | None, now: float) -> None:
        short = None if served is None else short_state(served)
        changed = self._shown.get("link", ()) != short
        if not self._is_due("link", now, LINK_EVERY) and not changed:
            return
        self._due["link"] = now + LINK_EVERY
        self._shown["link"] = short
        state = no_link(self._station.connecting) if served is None else link_state(served)
        self._tell({"view": "link", **state})

    def _messages(self, source: Source, shown: float, at: float | None, now: float) -> None:
        with_sparks = self._is_due("sparks", now, SPARKS_EVERY)
        rows = message_rows(source, shown, at=at, with_sparks=with_sparks)
        marks = [(row["t"], row["count"], round(row["rate"], 1)) for row in rows]
        if self._shown.get("messages") == marks and (at is not None or not with_sparks):
            return
        self._shown["messages"] = marks
        self._tell({"view": "messages", "t": shown, "rows": rows})

    def _events(self, source: Source, at: float | None) -> None:
        if at is not None and self._shown.get("events at") != at:
            self._shown["events at"] = at
            self._shown.pop("events", None)
        known = self._shown.get("events")
        newest = source.happenings.newest
        if known == newest:
            return
        self._shown["events"] = newest
        self._tell({"view": "events", "replace": known is None, "events": source.happenings.since(known or 0, at)})

    def _marks(self, source: Source) -> None:
        known = self._shown.get("marks")
        newest = source.happenings.newest, source.marks.newest
        if known == newest:
            return
        self._shown["marks"] = newest
        events, others = known or (0, 0)
        found = [*source.happenings.since(events), *source.marks.since(others)]
        self._tell({"view": "marks", "replace": known is None, "marks": sorted(found, key=lambda mark: mark["t"])})

    def _plot(self, feed: PlotFeed, source: Source, now: float) -> None:
        batch = feed.batch(source.history, now)
        if batch is not None:
            self._out.append(batch)

    def _feed(self, plot: Plot) -> PlotFeed:
        """Of the fields that there are; the others are named."""
        source = self._source()
        known = []
        for name in plot.fields:
            if source is None:
                break
            try:
                source.history.find(name)
                known.append(name)
            except UsageError as error:
                self._tell_error("field", str(error))
        return PlotFeed(msgspec.structs.replace(plot, fields=tuple(known)))

    # ---- inside

    def _source(self) -> Source | None:
        if self._replay is not None:
            return self._replay.source
        if self._wants.source != "live":
            return None  # it could not be opened
        served = self._station.served
        return None if served is None else served.source

    def _choose(self, views: Views) -> None:
        self._replay = None
        if not isinstance(views.source, OfRecording):
            return
        try:
            self._replay = replay = self._library.open(views.source.recording)
        except (WirebondError, OSError) as error:
            self._tell_error("recording", str(error))
            return
        told = {
            "view": "recording",
            "name": replay.name,
            "from": 0.0,
            "to": replay.duration,
            "problems": replay.problems,
        }
        self._tell(with_chinese(told, "problems"))

    def _forget(self) -> None:
        """Another source: all is new."""
        self._plots = {plot.id: self._feed(plot) for plot in self._wants.plots}
        self._due.clear()
        self._shown.clear()

    def _is_due(self, view: str, now: float, every: float) -> bool:
        if now < self._due.get(view, 0.0):
            return False
        self._due[view] = now + every
        return True

    def _tell_error(self, error: str, text: str) -> None:
        self._tell(with_chinese({"view": "error", "error": error, "text": text}, "text"))

    def _tell(self, value: dict[str, Any]) -> None:
        self._out.append(encode(value).decode())

    def _taken(self) -> list[str | bytes]:
        out, self._out = self._out, []
        return out
